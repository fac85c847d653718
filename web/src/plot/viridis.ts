// SPDX-License-Identifier: Apache-2.0

// Viridis at 0, 1/4, ... 1.
const kStops: [number, number, number][] = [
  [68, 1, 84],
  [59, 82, 139],
  [33, 145, 140],
  [94, 201, 98],
  [253, 231, 37],
];

/** Red, green, blue of a part from 0 to 1 of the scale. */
export function viridis(part: number): [number, number, number] {
  const place = Math.min(1, Math.max(0, part)) * (kStops.length - 1);
  const i = Math.min(kStops.length - 2, Math.floor(place));
  const a = kStops[i] ?? [0, 0, 0];
  const b = kStops[i + 1] ?? a;
  const mix = (k: 0 | 1 | 2): number => Math.round(a[k] + (place - i) * (b[k] - a[k]));
  return [mix(0), mix(1), mix(2)];
}
