// SPDX-License-Identifier: Apache-2.0
// Curves and points over one x that rises.
import { useMemo } from "preact/hooks";
import uPlot from "uplot";
import { brief } from "../base/numbers";
import type { Axis } from "./axes";
import { Chart } from "./chart";
import { styled } from "./colours";
import type { Caption } from "./figure";
import { Figure, Keys } from "./figure";

export interface LineSeries {
  label: string;
  values: readonly (number | null)[];
  colour: string;
  /** Points without a line. */
  dots?: boolean;
  dashed?: boolean;
  width?: number;
}

interface Lines extends Caption {
  places: readonly number[];
  series: LineSeries[];
  x: Axis;
  y: Axis;
  aspect?: number;
}

function lookOf({ label, colour, dots, dashed, width = 1.5 }: LineSeries): uPlot.Series {
  const stroke = (): string => styled(colour);
  if (dots) return { label, paths: () => null, points: { show: true, size: 4, width: 0, fill: stroke, stroke } };
  return { label, stroke, width, pxAlign: 0, points: { show: false }, ...(dashed ? { dash: [4, 4] } : {}) };
}

export function LineChart({ places, series, x, y, aspect = 1.3, ...caption }: Lines) {
  const data = useMemo<uPlot.AlignedData>(() => [[...places], ...series.map(({ values }) => [...values])], [places, series]);
  const first = series[0]?.values ?? [];
  return (
    <Figure {...caption}>
      <Chart
        name={caption.title}
        count={places.length}
        aspect={aspect}
        x={x}
        y={y}
        data={data}
        series={series.map(lookOf)}
        hover={{
          count: places.length,
          at: (i) => [places[i] ?? 0, first[i] ?? null],
          words: (i) => `${brief(places[i], 4)}: ${series.map(({ label, values }) => `${label} ${brief(values[i], 4)}`).join(", ")}`,
          find: (place) => nearestOf(places, place),
        }}
      />
      <Keys keys={series} />
    </Figure>
  );
}

/** Index of the nearest of values that rise. */
function nearestOf(places: readonly number[], place: number): number {
  let [low, high] = [0, places.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if ((places[middle] ?? 0) < place) low = middle;
    else high = middle;
  }
  return Math.abs((places[low] ?? 0) - place) < Math.abs((places[high] ?? 0) - place) ? low : high;
}
