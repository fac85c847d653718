// SPDX-License-Identifier: Apache-2.0
// A chart of uPlot: axes, lines and bars are its own; fields and dense points are painted over them. The pointer and the
// arrow keys name the nearest datum.
import "uplot/dist/uPlot.min.css";
import type { RefObject } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { axisOf, scaleOf } from "./axes";
import type { Axis } from "./axes";
import { drawWhenNear } from "./drawings";

/** Data that can be named. */
export interface Hover {
  count: number;
  /** A bar has no y. */
  at: (i: number) => [number, number | null];
  words: (i: number) => string;
  /** The datum of a place, -1 for none; without it the nearest one. */
  find?: (x: number, y: number) => number;
}

/** To paint in the coordinates of the chart; `unit`: a CSS pixel. */
export interface Painter {
  canvas: CanvasRenderingContext2D;
  x: (value: number) => number;
  y: (value: number) => number;
  unit: number;
}

export interface ChartLook {
  /** For readers that do not see it. */
  name: string;
  /** Things that it shows. */
  count: number;
  /** Width by height. */
  aspect?: number;
  x: Axis;
  y: Axis;
  data: uPlot.AlignedData;
  series: uPlot.Series[];
  paint?: (painter: Painter) => void;
  hover?: Hover;
  /** The chart's arrow keys and clicks choose a datum. */
  chosen?: number;
  onChoose?: (i: number) => void;
  /** A dragged line chooses the data from the first to the last, a double click all (null), and these are shown. */
  part?: [number, number] | null;
  onPart?: (part: [number, number] | null) => void;
}

function painterOf(plot: uPlot): Painter {
  const { ctx: canvas } = plot;
  return {
    canvas,
    x: (value) => plot.valToPos(value, "x", true),
    y: (value) => plot.valToPos(value, "y", true),
    unit: uPlot.pxRatio,
  };
}

function paintClipped(plot: uPlot, paint: (painter: Painter) => void): void {
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  paint(painterOf(plot));
  ctx.restore();
}

const kReach = 30; // px

/** The datum at a place of the plot, px; -1 for none. */
function datumAt(plot: uPlot, hover: Hover, left: number, top: number): number {
  if (hover.find) return hover.find(plot.posToVal(left, "x"), plot.posToVal(top, "y"));
  let best = -1;
  let least = kReach;
  for (let i = 0; i < hover.count; ++i) {
    const [x, y] = hover.at(i);
    const distance = Math.hypot(plot.valToPos(x, "x") - left, y === null ? 0 : plot.valToPos(y, "y") - top);
    if (distance >= least) continue;
    least = distance;
    best = i;
  }
  return best;
}

/** Shows the chosen data alone, or all. */
function showPart(plot: uPlot, { part, count }: ChartLook): void {
  plot.setScale("x", part ? { min: part[0] - 0.5, max: part[1] + 0.5 } : { min: 0, max: count - 1 });
}

/** The data that the dragged line covers, in part at least. */
function choosePart(plot: uPlot, { onPart, count }: ChartLook): void {
  const { left, width } = plot.select;
  if (width <= 0) return;
  plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  const at = (place: number): number => Math.min(count - 1, Math.max(0, Math.round(plot.posToVal(place, "x"))));
  onPart?.([at(left), at(left + width)]);
}

type OnName = (plot: uPlot, hover: Hover | undefined, index: number) => void;

/** The plot of an element; `latest`: the look that the component has now. */
function makePlot(element: HTMLElement, look: ChartLook, latest: () => ChartLook, onName: OnName): uPlot {
  const zooms = look.x.names !== undefined;
  const pointed = (plot: uPlot): number => {
    const { left = -1, top = -1 } = plot.cursor;
    const { hover } = latest();
    return hover && left >= 0 ? datumAt(plot, hover, left, top) : -1;
  };
  const options: uPlot.Options = {
    width: element.clientWidth,
    height: element.clientHeight,
    legend: { show: false },
    cursor: { x: zooms, y: false, points: { show: false }, drag: { x: zooms, y: false, setScale: !look.onPart } },
    padding: [8, 12, 0, 0],
    scales: { x: scaleOf(look.x), y: scaleOf(look.y) },
    axes: [axisOf(look.x, "x"), axisOf(look.y, "y")],
    series: [{}, ...look.series],
    hooks: {
      draw: [
        (plot) => {
          const { paint } = latest();
          if (paint) paintClipped(plot, paint);
        },
      ],
      setSelect: look.onPart ? [(plot) => choosePart(plot, latest())] : [],
      // Drawing moves no pointer.
      setCursor: [(plot) => plot.cursor.event && onName(plot, latest().hover, pointed(plot))],
    },
  };
  const plot = new uPlot(options, look.data, element);
  plot.over.addEventListener("click", () => {
    const index = pointed(plot);
    if (index >= 0) latest().onChoose?.(index);
  });
  if (look.onPart) plot.over.addEventListener("dblclick", () => latest().onPart?.(null));
  if (latest().part) showPart(plot, latest());
  return plot;
}

const kTipHeight = 30; // px

/** The words of a datum beside it, and a ring around it. */
function showDatum(plot: uPlot, hover: Hover | undefined, index: number, tip: HTMLElement, ring: HTMLElement): void {
  tip.hidden = ring.hidden = index < 0 || !hover;
  if (tip.hidden || !hover) return;
  const [x, y] = hover.at(index);
  const left = plot.over.offsetLeft + plot.valToPos(x, "x");
  const top = plot.over.offsetTop + (y === null ? Math.max(kTipHeight, plot.cursor.top ?? 0) : plot.valToPos(y, "y"));
  tip.textContent = hover.words(index);
  const isLeft = left < plot.width / 2;
  tip.style.left = isLeft ? `${left + 10}px` : "auto";
  tip.style.right = isLeft ? "auto" : `${plot.width - left + 10}px`;
  tip.style.top = `${Math.max(0, top - kTipHeight)}px`;
  ring.hidden = y === null;
  ring.style.left = `${left}px`;
  ring.style.top = `${top}px`;
}

/** The plot in the box, made when it comes near the window; `onName` is called with the datum under the pointer. */
function usePlot(box: RefObject<HTMLDivElement>, look: ChartLook, onName: OnName): RefObject<uPlot> {
  const made = useRef<uPlot | null>(null);
  const latest = useRef(look);
  latest.current = look;
  useLayoutEffect(() => {
    const element = box.current;
    if (!element) return;
    const end = drawWhenNear(element, {
      title: look.name,
      count: look.count,
      canvas: () => element.querySelector("canvas"),
      draw: () => {
        if (!made.current && element.clientWidth > 0) made.current = makePlot(element, look, () => latest.current, onName);
      },
      redraw: () => made.current?.redraw(),
    });
    const watch = new ResizeObserver(() => {
      const { clientWidth: width, clientHeight: height } = element;
      // Paper scales the canvas as it is.
      if (width === 0 || matchMedia("print").matches) return;
      const plot = made.current;
      if (plot && (plot.width !== width || plot.height !== height)) plot.setSize({ width, height });
    });
    watch.observe(element);
    return () => {
      end();
      watch.disconnect();
      made.current?.destroy();
      made.current = null;
    };
  }, [look.data, look.name]);
  useLayoutEffect(() => made.current?.redraw(), [look.chosen, look.paint]);
  useLayoutEffect(() => {
    if (made.current && look.onPart) showPart(made.current, look);
  }, [look.part?.[0], look.part?.[1]]);
  return made;
}

export function Chart(look: ChartLook) {
  const { hover, onChoose, chosen = -1 } = look;
  const box = useRef<HTMLDivElement>(null);
  const tip = useRef<HTMLDivElement>(null);
  const ring = useRef<HTMLDivElement>(null);
  const named = useRef(-1);
  const name = (plot: uPlot | null, of: Hover | undefined, index: number): void => {
    named.current = index;
    if (plot && tip.current && ring.current) showDatum(plot, of, index, tip.current, ring.current);
  };
  const plot = usePlot(box, look, name);
  const onKey = (event: KeyboardEvent): void => {
    const by = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    if (by === 0 || !hover) return;
    event.preventDefault();
    event.stopPropagation();
    const index = Math.min(hover.count - 1, Math.max(0, (onChoose ? chosen : named.current) + by));
    onChoose?.(index);
    name(plot.current, hover, index);
  };
  const slider = {
    role: "slider" as const,
    "aria-valuemin": 1,
    "aria-valuemax": Math.max(1, look.count),
    "aria-valuenow": Math.max(1, chosen + 1),
    "aria-valuetext": chosen >= 0 ? hover?.words(chosen) : "none",
  };
  return (
    <div
      ref={box}
      class="chart"
      style={`aspect-ratio: ${look.aspect ?? 1.5}`}
      tabIndex={hover ? 0 : undefined}
      aria-label={look.name}
      onKeyDown={onKey}
      onBlur={() => name(plot.current, hover, -1)}
      {...(onChoose ? slider : { role: "img" as const })}
    >
      <div ref={ring} class="ring" hidden />
      <div ref={tip} class="tip" aria-live="polite" hidden />
    </div>
  );
}
