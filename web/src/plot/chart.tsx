// SPDX-License-Identifier: Apache-2.0
// A chart of uPlot: axes, lines and bars are its own; fields and dense points are painted over them. The pointer and the
// arrow keys name the nearest datum.
import "uplot/dist/uPlot.min.css";
import { useLayoutEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { brief } from "../base/numbers";
import { styled } from "./colours";
import { drawWhenNear } from "./figures";

export interface Axis {
  label: string;
  /** Where it ends; as the data without. */
  range?: [number, number];
  logarithmic?: boolean;
  /** y of images points down. */
  reversed?: boolean;
  /** Names of the places 0, 1, ...; a dragged line zooms, a double click shows all. */
  names?: readonly string[];
  /** Names are written upward. */
  upright?: boolean;
  text?: (value: number) => string;
}

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
}

function scaleOf({ range, logarithmic, reversed, names }: Axis): uPlot.Scale {
  const scale: uPlot.Scale = { time: false, distr: logarithmic ? 3 : 1, dir: reversed ? -1 : 1 };
  if (range) return { ...scale, range: () => range };
  if (!names) return scale;
  const last = names.length - 1;
  // From the first to the last datum, or not known yet: all of it.
  const isAll = (low: number, high: number): boolean => !(high > low) || (low === 0 && high === last);
  return { ...scale, range: (_, low, high) => (isAll(low, high) ? [-0.5, last + 0.5] : [Math.max(-0.5, low), Math.min(last + 0.5, high)]) };
}

/** 1, 2 and 5 times each power of ten. */
function logarithmicTicks(low: number, high: number): number[] {
  const ticks: number[] = [];
  for (let power = 10 ** Math.floor(Math.log10(low)); power <= high; power *= 10) ticks.push(power, 2 * power, 5 * power);
  return ticks.filter((tick) => tick >= low && tick <= high);
}

const kLetter = 6.6; // px
const widest = (texts: readonly (string | number | null)[]): number => texts.reduce((most: number, text) => Math.max(most, String(text ?? "").length), 0);

function axisOf({ label, names, upright, logarithmic, text = (value) => brief(value, 5) }: Axis, side: "x" | "y"): uPlot.Axis {
  const font = "12px system-ui, sans-serif";
  const axis: uPlot.Axis = {
    scale: side,
    label,
    labelSize: label ? 20 : 0,
    labelGap: side === "x" ? 0 : 2,
    size: 24,
    font,
    labelFont: font,
    stroke: () => styled("--text"),
    grid: { stroke: () => styled("--line"), width: 1, show: !names },
    ticks: { stroke: () => styled("--line"), width: 1, size: 4 },
    gap: 3,
    values: (_, splits) => splits.map((value: number | null) => (value === null ? "" : text(value))),
  };
  if (logarithmic) {
    axis.splits = (_, __, low, high) => logarithmicTicks(low, high);
    axis.filter = (_, splits) => splits;
  }
  if (side === "y") axis.size = (_, values) => 14 + kLetter * widest(values ?? []);
  if (!names) return axis;
  const length = kLetter * widest(names);
  axis.values = (_, splits) => splits.map((value) => names[value] ?? "");
  axis.incrs = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000];
  axis.space = side === "x" && !upright ? Math.max(30, length + 12) : 14;
  if (upright) {
    axis.rotate = -90;
    axis.size = 12 + length;
  }
  return axis;
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

/** What a chart has between its drawings. */
interface Made {
  plot: uPlot;
  /** Of the named datum. */
  index: number;
}

function show(made: Made, look: ChartLook, tip: HTMLElement, ring: HTMLElement, index: number, top: number): void {
  const { plot } = made;
  made.index = index;
  tip.hidden = index < 0;
  ring.hidden = true;
  if (index < 0 || !look.hover) return;
  const [x, y] = look.hover.at(index);
  const left = plot.over.offsetLeft + plot.valToPos(x, "x");
  const down = plot.over.offsetTop + (y === null ? top : plot.valToPos(y, "y"));
  tip.textContent = look.hover.words(index);
  const half = plot.width / 2;
  tip.style.left = left < half ? `${left + 10}px` : "auto";
  tip.style.right = left < half ? "auto" : `${plot.width - left + 10}px`;
  tip.style.top = `${Math.max(0, down - 30)}px`;
  if (y === null) return;
  ring.hidden = false;
  ring.style.left = `${left}px`;
  ring.style.top = `${down}px`;
}

export function Chart(look: ChartLook) {
  const box = useRef<HTMLDivElement>(null);
  const tip = useRef<HTMLDivElement>(null);
  const ring = useRef<HTMLDivElement>(null);
  const made = useRef<Made | null>(null);
  const latest = useRef(look);
  latest.current = look;
  const name = (index: number, top: number): void => {
    if (made.current && tip.current && ring.current) show(made.current, latest.current, tip.current, ring.current, index, top);
  };
  useLayoutEffect(() => {
    const element = box.current;
    if (!element) return;
    const zooms = look.x.names !== undefined;
    const make = (): void => {
      if (made.current || element.clientWidth === 0) return;
      const options: uPlot.Options = {
        width: element.clientWidth,
        height: element.clientHeight,
        legend: { show: false },
        cursor: { x: zooms, y: false, points: { show: false }, drag: { x: zooms, y: false } },
        padding: [8, 12, 0, 0],
        scales: { x: scaleOf(look.x), y: scaleOf(look.y) },
        axes: [axisOf(look.x, "x"), axisOf(look.y, "y")],
        series: [{}, ...look.series],
        hooks: {
          draw: [(plot) => latest.current.paint && paintClipped(plot, latest.current.paint)],
          setCursor: [
            (plot) => {
              const { left = -1, top = -1 } = plot.cursor;
              const { hover } = latest.current;
              if (hover && made.current) name(left < 0 ? -1 : datumAt(plot, hover, left, top), top);
            },
          ],
        },
      };
      const plot = new uPlot(options, look.data, element);
      made.current = { plot, index: -1 };
      plot.over.addEventListener("click", () => {
        const { left = -1, top = -1 } = plot.cursor;
        const { hover, onChoose } = latest.current;
        const index = hover ? datumAt(plot, hover, left, top) : -1;
        if (index >= 0) onChoose?.(index);
      });
    };
    const end = drawWhenNear(element, {
      title: look.name,
      count: look.count,
      canvas: () => element.querySelector("canvas"),
      draw: make,
      redraw: () => made.current?.plot.redraw(true, true),
    });
    const watch = new ResizeObserver(() => {
      const { clientWidth: width, clientHeight: height } = element;
      const plot = made.current?.plot;
      // Paper scales the canvas as it is.
      if (matchMedia("print").matches) return;
      if (plot && width > 0 && (plot.width !== width || plot.height !== height)) plot.setSize({ width, height });
    });
    watch.observe(element);
    return () => {
      end();
      watch.disconnect();
      made.current?.plot.destroy();
      made.current = null;
    };
  }, [look.data, look.name]);
  useLayoutEffect(() => made.current?.plot.redraw(true, true), [look.chosen, look.paint]);
  const onKey = (event: KeyboardEvent): void => {
    const by = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    if (by === 0 || !look.hover) return;
    event.preventDefault();
    event.stopPropagation();
    const from = look.onChoose ? (look.chosen ?? -1) : (made.current?.index ?? -1);
    const index = Math.min(look.hover.count - 1, Math.max(0, from + by));
    look.onChoose?.(index);
    name(index, 30);
  };
  const chosen = look.chosen ?? -1;
  const slider = {
    role: "slider" as const,
    "aria-valuemin": 1,
    "aria-valuemax": Math.max(1, look.count),
    "aria-valuenow": Math.max(1, chosen + 1),
    "aria-valuetext": chosen >= 0 ? look.hover?.words(chosen) : "none",
  };
  return (
    <div
      ref={box}
      class="chart"
      style={`aspect-ratio: ${look.aspect ?? 1.5}`}
      tabIndex={look.hover ? 0 : undefined}
      aria-label={look.name}
      onKeyDown={onKey}
      onBlur={() => name(-1, 0)}
      {...(look.onChoose ? slider : { role: "img" as const })}
    >
      <div ref={ring} class="ring" hidden />
      <div ref={tip} class="tip" aria-live="polite" hidden />
    </div>
  );
}
