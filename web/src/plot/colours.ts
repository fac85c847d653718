// SPDX-License-Identifier: Apache-2.0
// Colours on canvases: those of the page's style, and scales.
import { viridis } from "./viridis";

/** A variable of the style sheet, as it is now: light, dark or for paper. */
export const styled = (name: string): string => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

const kSeries = 8;
/** The variable of the style sheet that holds the colour of the i-th of several things. */
export const seriesName = (index: number): string => `--series-${index % kSeries}`;

export const ramp = (part: number, opacity = 1): string => `rgb(${viridis(part).join(" ")} / ${opacity})`;

/** For lines: without the end of the ramp that the page's ground hides. */
export function lineRamp(part: number): string {
  const from = Number(styled("--line-ramp"));
  return ramp(from + (1 - from) * part);
}

/** Blue, white, red for -1, 0, 1. */
export function signed(value: number): string {
  const part = Math.min(Math.abs(value), 1);
  const end = value < 0 ? [23, 90, 158] : [179, 38, 30];
  return `rgb(${end.map((v) => Math.round(255 + part * (v - 255))).join(" ")})`;
}
