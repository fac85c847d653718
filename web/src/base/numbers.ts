// SPDX-License-Identifier: Apache-2.0
// Numbers as text, the same on all pages. apps/report/page_text.cc writes them for pages without script.

/** With a number of significant digits, without needless zeros. */
export function brief(value: number | null | undefined, digits = 3): string {
  return value === null || value === undefined ? "–" : String(Number(value.toPrecision(digits)));
}

/** Value and sigma with the digits that sigma justifies. */
export function withSigma(value: number, sigma: number | null): [string, string] {
  if (sigma === null) return [brief(value, 6), "not determined"];
  if (!(sigma > 0)) return [brief(value, 9), "fixed"];
  const digits = 1 - Math.floor(Math.log10(sigma));
  if (Math.abs(value) >= 1e6 || (value !== 0 && Math.abs(value) < 1e-4) || digits > 9) {
    const significant = Math.max(2, Math.min(15, Math.floor(Math.log10(Math.abs(value) || 1)) + digits + 1));
    return [value.toExponential(significant - 1), sigma.toExponential(1)];
  }
  const shown = Math.min(Math.max(digits, 0), 12);
  return [value.toFixed(shown), sigma.toFixed(shown)];
}

/** "m^-1" -> "m⁻¹". */
export function unitText(unit: string): string {
  if (unit === "1") return "";
  return unit.replace(/\^-?\d+/g, (power) => [...power.slice(1)].map((c) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(c)] ?? "⁻").join(""));
}

export const counted = (count: number, thing: string): string => `${count} ${thing}${count === 1 ? "" : "s"}`;

/** The least of 1, 1.5, 2, 3, 5, 7 times a power of ten that is not below a positive value: where an axis ends. */
export function roundUp(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  const step = [1, 1.5, 2, 3, 5, 7].find((each) => each * power >= value * (1 - 1e-9)) ?? 10;
  return Number((step * power).toPrecision(3));
}

/** Of values of which some may be missing; [Infinity, -Infinity] of none. Math.min(...) takes no array of any length. */
export function rangeOf(values: Iterable<number | null>): [number, number] {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) {
    if (value === null) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  return [low, high];
}

export const isKnown = (value: number | null | undefined): value is number => value !== null && value !== undefined;
