// SPDX-License-Identifier: Apache-2.0
// Raw image, micro images and virtual image of a plenoptic camera: what a place in one is in the others.
import type { Focus, Lenses } from "../api/types";
import type { Pixel } from "./choose";

/** Index of the micro lens whose centre is nearest; -1 outside of all micro images. */
export function lensAt(lenses: Lenses, [x, y]: Pixel): number {
  let nearest = lenses.pitch / 2;
  let found = -1;
  lenses.centres.forEach(([cx, cy], i) => {
    const distance = Math.hypot(cx - x, cy - y);
    if (distance >= nearest) return;
    nearest = distance;
    found = i;
  });
  return found;
}

/** A point of the virtual image: where it lies in the raw image's pixels, and its virtual depth. */
export interface VirtualPoint {
  at: Pixel;
  depth: number;
}

/** The virtual depth at a raw pixel; null where it is unknown. */
export function depthAt(focus: Focus, [x, y]: Pixel): number | null {
  const column = Math.round((x - focus.offset[0]) / focus.scale / focus.step);
  const row = Math.round((y - focus.offset[1]) / focus.scale / focus.step);
  if (column < 0 || row < 0 || column >= focus.columns || row >= focus.rows) return null;
  return focus.depth[row * focus.columns + column] ?? null;
}

export function virtualPointAt(focus: Focus, at: Pixel): VirtualPoint | null {
  const depth = depthAt(focus, at);
  return depth === null ? null : { at, depth };
}

/** The point of the virtual image that a raw pixel shows. Its depth is that at the point itself, which a few steps find. */
export function virtualPointOf(focus: Focus, lenses: Lenses, raw: Pixel): VirtualPoint | null {
  const centre = lenses.centres[lensAt(lenses, raw)];
  if (!centre) return null;
  let at: Pixel = [centre[0], centre[1]];
  for (let step = 0; step < 4; ++step) {
    const depth = depthAt(focus, at);
    if (depth === null) return null;
    at = [centre[0] + depth * (raw[0] - centre[0]), centre[1] + depth * (raw[1] - centre[1])];
  }
  return virtualPointAt(focus, at);
}

/** The raw pixels that show a point: c + (p - c) / v in each micro image that it falls into (docs/conventions.md). */
export function rawPixelsOf(lenses: Lenses, { at, depth }: VirtualPoint): Pixel[] {
  const pixels: Pixel[] = [];
  for (const [cx, cy] of lenses.centres) {
    const dx = (at[0] - cx) / depth;
    const dy = (at[1] - cy) / depth;
    if (Math.hypot(dx, dy) < lenses.pitch / 2) pixels.push([cx + dx, cy + dy]);
  }
  return pixels;
}

/** A raw pixel in the focused image. */
export const inFocused = (focus: Focus, [x, y]: Pixel): Pixel => [
  (x - focus.offset[0]) / focus.scale,
  (y - focus.offset[1]) / focus.scale,
];
export const fromFocused = (focus: Focus, [x, y]: Pixel): Pixel => [
  focus.offset[0] + focus.scale * x,
  focus.offset[1] + focus.scale * y,
];
