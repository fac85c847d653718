// SPDX-License-Identifier: Apache-2.0
// Bars over names or, of a histogram, over values; one series before the other, and lines over them.
import { useMemo } from "preact/hooks";
import uPlot from "uplot";
import { brief, rangeOf } from "../base/numbers";
import type { Axis } from "./axes";
import { Chart } from "./chart";
import { styled } from "./colours";
import type { Caption } from "./figure";
import { Figure, Keys } from "./figure";

export interface BarSeries {
  label: string;
  values: readonly (number | null)[];
  colour: string;
  line?: boolean;
}

interface Bars extends Caption {
  names: readonly string[];
  /** Middles of the bins of a histogram: its axis has numbers in place of names. */
  middles?: readonly number[];
  series: BarSeries[];
  x?: string;
  y: Omit<Axis, "names">;
  unit?: string;
  /** In place of the values of the series. */
  words?: (i: number) => string;
  aspect?: number;
}

/** From zero, or on a logarithmic axis from below the least, to above the largest value. */
function endsOf(series: BarSeries[], logarithmic = false): [number, number] {
  const [low, high] = rangeOf(series.flatMap(({ values }) => values));
  if (!(low <= high)) return [0, 1];
  if (logarithmic) return [low / 2, 1.5 * high];
  return [Math.min(0, 1.05 * low), high > 0 ? 1.05 * high : low < 0 ? 0 : 1];
}

export function BarChart({ names, middles, series, x = "", y, unit = "", words, aspect = 1.2, ...caption }: Bars) {
  const places = middles ?? names.map((_, i) => i);
  const data = useMemo<uPlot.AlignedData>(() => [[...places], ...series.map(({ values }) => [...values])], [names, series]);
  const size = middles || names.length > 60 ? 1 : 0.85;
  const first = places[0] ?? 0;
  const step = ((places.at(-1) ?? 0) - first) / (places.length - 1) || 1;
  const all = series.map(({ label, values }) => (i: number) => `${series.length > 1 ? `${label} ` : ""}${brief(values[i], 4)} ${unit}`);
  return (
    <Figure {...caption}>
      <Chart
        name={caption.title}
        count={names.length}
        aspect={aspect}
        x={middles ? { label: x, range: [first - step / 2, first + (places.length - 0.5) * step] } : { label: x, names }}
        y={{ range: endsOf(series, y.logarithmic), ...y }}
        data={data}
        series={series.map(({ label, colour, line }) =>
          line
            ? { label, stroke: () => styled(colour), width: 2, points: { show: false } }
            : { label, fill: () => styled(colour), width: 0, points: { show: false }, paths: uPlot.paths.bars!({ size: [size, Infinity] }) },
        )}
        hover={{
          count: names.length,
          at: (i) => [places[i] ?? 0, null],
          words: (i) => `${names[i]}: ${words ? words(i) : all.map((each) => each(i)).join(", ")}`,
          find: (place) => Math.min(names.length - 1, Math.max(0, Math.round((place - first) / step))),
        }}
      />
      <Keys keys={series} />
    </Figure>
  );
}
