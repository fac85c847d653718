// SPDX-License-Identifier: Apache-2.0
// Scales and axes of charts.
import type uPlot from "uplot";
import { brief } from "../base/numbers";
import { styled } from "./colours";

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

export function scaleOf({ range, logarithmic, reversed, names }: Axis): uPlot.Scale {
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

export function axisOf({ label, names, upright, logarithmic, text = (value) => brief(value, 5) }: Axis, side: "x" | "y"): uPlot.Axis {
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
