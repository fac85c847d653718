// SPDX-License-Identifier: Apache-2.0
// Bars over names or, of a histogram, over values; one series before the other, and lines over them.
import { useMemo } from "preact/hooks";
import uPlot from "uplot";
import { brief } from "../base/numbers";
import type { Axis } from "./axes";
import { Chart } from "./chart";
import type { ChartLook } from "./chart";
import { styled } from "./colours";

export interface BarSeries {
  label: string;
  values: readonly (number | null)[];
  /** A name of the style sheet, or what fills the bars. */
  colour: string | (() => string | CanvasPattern);
  line?: boolean;
}

export interface BarsLook extends Pick<ChartLook, "name" | "aspect" | "chosen" | "onChoose" | "part" | "onPart" | "paint"> {
  names: readonly string[];
  /** Middles of the bins of a histogram: its axis has numbers in place of names. */
  middles?: readonly number[] | undefined;
  series: readonly BarSeries[];
  x: string;
  y: Axis;
  /** Widest bar, px. */
  widest?: number;
  unit?: string;
  /** In place of the values of the series. */
  words?: ((i: number) => string) | undefined;
}

const kMostWithGaps = 60;

export function Bars({ names, middles, series, x, y, widest = Infinity, unit = "", words, ...look }: BarsLook) {
  const places = middles ?? names.map((_, i) => i);
  const data = useMemo<uPlot.AlignedData>(() => [[...places], ...series.map(({ values }) => [...values])], [names, series]);
  const size = middles || names.length > kMostWithGaps ? 1 : 0.85;
  const first = places[0] ?? 0;
  const step = ((places.at(-1) ?? 0) - first) / (places.length - 1) || 1;
  const all = series.map(({ label, values }) => (i: number) => `${series.length > 1 ? `${label} ` : ""}${brief(values[i], 4)} ${unit}`);
  const looks = series.map(({ label, colour, line }): uPlot.Series => {
    const paint = typeof colour === "string" ? () => styled(colour) : colour;
    return line
      ? { label, stroke: paint, width: 2, points: { show: false } }
      : { label, fill: paint, width: 0, points: { show: false }, paths: uPlot.paths.bars!({ size: [size, widest] }) };
  });
  return (
    <Chart
      {...look}
      count={names.length}
      x={middles ? { label: x, range: [first - step / 2, first + (places.length - 0.5) * step] } : { label: x, names }}
      y={y}
      data={data}
      series={looks}
      hover={{
        count: names.length,
        at: (i) => [places[i] ?? 0, null],
        words: (i) => `${names[i]}: ${words ? words(i) : all.map((each) => each(i)).join(", ")}`,
        find: (place) => Math.min(names.length - 1, Math.max(0, Math.round((place - first) / step))),
      }}
    />
  );
}
