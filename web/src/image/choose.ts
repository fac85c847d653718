// SPDX-License-Identifier: Apache-2.0
// The markers that a pointer chooses in an image.
import type { Point } from "../api/types";

/** x, y, px. */
export type Pixel = [number, number];

function isInside(x: number, y: number, line: Pixel[]): boolean {
  let inside = false;
  line.forEach(([x1, y1], i) => {
    const [x2, y2] = line[(i + 1) % line.length] ?? [x1, y1];
    if (y1 > y !== y2 > y && x < x1 + ((y - y1) / (y2 - y1)) * (x2 - x1)) inside = !inside;
  });
  return inside;
}

/** Markers with a point inside of a closed line. */
export function markersInside(points: Point[], line: Pixel[]): number[] {
  return [...new Set(points.filter(([, x, y]) => isInside(x, y, line)).map(([marker]) => marker))];
}

/** The marker whose point is nearest to a pixel, within a radius. */
export function markersAt(points: Point[], [x, y]: Pixel, radius: number): number[] {
  let nearest = radius;
  let found: number[] = [];
  for (const [marker, px, py] of points) {
    const distance = Math.hypot(px - x, py - y);
    if (distance > nearest) continue;
    nearest = distance;
    found = [marker];
  }
  return found;
}
