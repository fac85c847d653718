// SPDX-License-Identifier: Apache-2.0
// A bar a frame (or a marker, a lens type). Excluded ones are hatched; where one can be chosen, a click and the arrow keys do.
import { useMemo } from "preact/hooks";
import uPlot from "uplot";
import { rangeOf } from "../base/numbers";
import { Chart } from "./chart";
import { styled } from "./colours";

export interface FrameBar {
  name: string;
  /** null: not known; the bar is hatched in full height when it is excluded. */
  size: number | null;
  words: string;
  excluded?: boolean;
}

interface Bars {
  /** For readers that do not see it. */
  name: string;
  bars: readonly FrameBar[];
  x: string;
  y: string;
  aspect?: number;
  chosen?: string;
  onChoose?: (name: string) => void;
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

/** Bars of one look: uPlot's bars have one fill a series. */
const series = (fill: () => string | CanvasPattern, gaps: boolean): uPlot.Series => ({
  fill,
  width: 0,
  points: { show: false },
  paths: uPlot.paths.bars!({ size: [gaps ? 0.85 : 1, 40] }),
});

export function FrameBars({ name, bars, x, y, aspect = 1.2, chosen, onChoose }: Bars) {
  const names = useMemo(() => bars.map((bar) => bar.name), [bars]);
  const most = Math.max(1e-9, rangeOf(bars.map((bar) => bar.size))[1]);
  const index = chosen === undefined ? -1 : names.indexOf(chosen);
  const data = useMemo<uPlot.AlignedData>(() => {
    const sizes = (which: (bar: FrameBar) => boolean): (number | null)[] =>
      bars.map((bar) => (which(bar) ? (bar.size ?? (bar.excluded ? most : null)) : null));
    return [bars.map((_, i) => i), sizes((bar) => !bar.excluded), sizes((bar) => bar.excluded ?? false)];
  }, [bars]);
  const gaps = bars.length <= 60;
  return (
    <div class="bars" data-bars={bars.length} data-chosen={chosen} data-excluded={bars.filter((bar) => bar.excluded).length}>
      <Chart
        name={name}
        count={bars.length}
        aspect={aspect}
        x={{ label: x, names }}
        y={{ label: y, range: [0, 1.05 * most] }}
        data={data}
        series={[series(() => styled("--series-0"), gaps), series(hatch, gaps)]}
        chosen={index}
        {...(onChoose ? { onChoose: (i: number) => names[i] !== undefined && onChoose(names[i]) } : {})}
        paint={({ canvas, x: at, unit }) => {
          if (index < 0) return;
          const width = Math.max(at(0.5) - at(-0.5), 3 * unit);
          canvas.fillStyle = styled("--chosen");
          canvas.fillRect(at(index) - width / 2, 0, width, canvas.canvas.height);
        }}
        hover={{
          count: bars.length,
          at: (i) => [i, null],
          words: (i) => `${names[i]}: ${bars[i]?.words}`,
          find: (place) => Math.min(names.length - 1, Math.max(0, Math.round(place))),
        }}
      />
    </div>
  );
}
