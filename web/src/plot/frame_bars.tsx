// SPDX-License-Identifier: Apache-2.0
// A bar a frame (or a marker, a lens type). Excluded ones are hatched; where one can be chosen, a click and the arrow
// keys do; where several can, a drag.
import { useMemo } from "preact/hooks";
import uPlot from "uplot";
import { rangeOf } from "../base/numbers";
import { Bars } from "./bars";
import type { BarSeries } from "./bars";
import { styled } from "./colours";

export interface FrameBar {
  name: string;
  /** null: not known; the bar is hatched in full height when it is excluded. */
  size: number | null;
  words: string;
  excluded?: boolean;
}

interface Shown {
  /** For readers that do not see it. */
  name: string;
  bars: readonly FrameBar[];
  x: string;
  y: string;
  aspect?: number;
  chosen?: string;
  onChoose?: (name: string) => void;
  /** Names of the bars that are shown, in the order of the bars; without it all. */
  part?: readonly string[] | undefined;
  /** A drag over bars chooses them, a double click all. */
  onPart?: (names: string[] | undefined) => void;
}

function hatch(): string | CanvasPattern {
  const tile = document.createElement("canvas");
  const size = Math.round(6 * uPlot.pxRatio);
  tile.width = tile.height = size;
  const canvas = tile.getContext("2d");
  if (!canvas) return styled("--bad");
  canvas.strokeStyle = styled("--bad");
  canvas.lineWidth = size / 4;
  canvas.beginPath();
  for (const shift of [-size, 0, size]) {
    canvas.moveTo(shift, size);
    canvas.lineTo(shift + size, 0);
  }
  canvas.stroke();
  return canvas.createPattern(tile, "repeat") ?? styled("--bad");
}

export function FrameBars({ name, bars, x, y, aspect = 1.2, chosen, onChoose, part, onPart }: Shown) {
  const names = useMemo(() => bars.map((bar) => bar.name), [bars]);
  const most = Math.max(1e-9, rangeOf(bars.map((bar) => bar.size))[1]);
  const index = chosen === undefined ? -1 : names.indexOf(chosen);
  const ends: [number, number] | null = part ? [names.indexOf(part[0] ?? ""), names.indexOf(part.at(-1) ?? "")] : null;
  // uPlot's bars have one fill a series.
  const series = useMemo<BarSeries[]>(() => {
    const sizes = (which: (bar: FrameBar) => boolean): (number | null)[] =>
      bars.map((bar) => (which(bar) ? (bar.size ?? (bar.excluded ? most : null)) : null));
    return [
      { label: "frames", values: sizes((bar) => !bar.excluded), colour: "--series-0" },
      { label: "excluded", values: sizes((bar) => bar.excluded ?? false), colour: hatch },
    ];
  }, [bars]);
  return (
    <div class="bars" data-bars={bars.length} data-chosen={chosen} data-part={part?.length} data-excluded={bars.filter((bar) => bar.excluded).length}>
      <Bars
        {...{ name, names, series, x, aspect }}
        y={{ label: y, range: [0, 1.05 * most] }}
        widest={40}
        words={(i) => bars[i]?.words ?? ""}
        chosen={index}
        {...(onChoose ? { onChoose: (i: number) => names[i] !== undefined && onChoose(names[i]) } : {})}
        {...(onPart
          ? {
              part: ends,
              onPart: (range: [number, number] | null) => onPart(range ? names.slice(range[0], range[1] + 1) : undefined),
            }
          : {})}
        paint={({ canvas, x: at, unit }) => {
          if (index < 0) return;
          const width = Math.max(at(0.5) - at(-0.5), 3 * unit);
          canvas.fillStyle = styled("--chosen");
          canvas.fillRect(at(index) - width / 2, 0, width, canvas.canvas.height);
        }}
      />
    </div>
  );
}
