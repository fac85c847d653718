// SPDX-License-Identifier: Apache-2.0
// A figure with bars of one or several series.
import { rangeOf } from "../base/numbers";
import type { Axis } from "./axes";
import { Bars } from "./bars";
import type { BarSeries, BarsLook } from "./bars";
import type { Caption } from "./figure";
import { Figure, Keys } from "./figure";

interface Charted extends Caption, Pick<BarsLook, "names" | "middles" | "unit" | "words"> {
  series: (BarSeries & { colour: string })[];
  x?: string;
  y: Omit<Axis, "names">;
  aspect?: number;
}

/** From zero, or on a logarithmic axis from below the least, to above the largest value. */
function endsOf(series: BarSeries[], logarithmic = false): [number, number] {
  const [low, high] = rangeOf(series.flatMap(({ values }) => values));
  if (!(low <= high)) return [0, 1];
  if (logarithmic) return [low / 2, 1.5 * high];
  return [Math.min(0, 1.05 * low), high > 0 ? 1.05 * high : low < 0 ? 0 : 1];
}

export function BarChart({ names, middles, series, x = "", y, unit = "", words, aspect = 1.2, ...caption }: Charted) {
  return (
    <Figure {...caption}>
      <Bars
        name={caption.title}
        {...{ names, middles, series, x, unit, words, aspect }}
        y={{ range: endsOf(series, y.logarithmic), ...y }}
      />
      <Keys keys={series} />
    </Figure>
  );
}
