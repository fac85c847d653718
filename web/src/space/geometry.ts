// SPDX-License-Identifier: Apache-2.0
// What a scene consists of, in the target's frame.
import type { Transform, Vector } from "../api/calibration";

export type { Vector };

export function apply(T: Transform, [x, y, z]: Vector): Vector {
  const row = (r: number): number => (T[4 * r] ?? 0) * x + (T[4 * r + 1] ?? 0) * y + (T[4 * r + 2] ?? 0) * z + (T[4 * r + 3] ?? 0);
  return [row(0), row(1), row(2)];
}

/** Of the rows of a 4 x 4 matrix. */
export function inverseOf(rows: number[][]): Transform {
  const at = (r: number, c: number): number => rows[r]?.[c] ?? 0;
  return [0, 1, 2].flatMap((r) => [at(0, r), at(1, r), at(2, r), -(at(0, r) * at(0, 3) + at(1, r) * at(1, 3) + at(2, r) * at(2, 3))]);
}

/** Middle of points and a radius that holds them. */
export function extentOf(points: Vector[]): { middle: Vector; radius: number } {
  const low: Vector = [Infinity, Infinity, Infinity];
  const high: Vector = [-Infinity, -Infinity, -Infinity];
  for (const p of points) {
    for (const k of [0, 1, 2] as const) {
      low[k] = Math.min(low[k], p[k]);
      high[k] = Math.max(high[k], p[k]);
    }
  }
  const middle: Vector = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2];
  return { middle, radius: Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) / 2 || 1 };
}

export interface SceneCamera {
  name: string;
  T_rig_camera: Transform;
  image_size: [number, number];
}
export interface ScenePose {
  name: string;
  T_target_rig: Transform;
}
/** A pose that is proposed. */
export interface Ghost {
  name: string;
  T_target_camera: Transform;
}

/** Pyramids of cameras: optical centre and the corners of the image. */
export interface World {
  middle: Vector;
  radius: number;
  markers: Vector[];
  /** Corners around the markers of a flat target; none of others. */
  outline: Vector[];
  axes: number;
  /** By pose and camera, five points each. */
  pyramids: Vector[][][];
}

const kFlat = 0.02; // of the extent, for a board that is bent

/** The convex hull of points in the plane z = 0, or near it; nothing where they lie elsewhere. */
export function outlineOf(points: Vector[]): Vector[] {
  const { radius } = extentOf(points);
  if (points.length < 3 || points.some(([, , z]) => Math.abs(z) > kFlat * radius)) return [];
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const side = (all: Vector[]): Vector[] => {
    const chain: Vector[] = [];
    for (const p of all) {
      for (;;) {
        const [a, b] = chain.slice(-2);
        if (!a || !b || (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
        chain.pop();
      }
      chain.push(p);
    }
    return chain.slice(0, -1);
  };
  return [...side(sorted), ...side(sorted.reverse())];
}

const kStill: Transform = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

/** Five points in the camera's frame; `size` of the longer half of its image. */
export function pyramidOf([width, height]: [number, number], size: number): Vector[] {
  const k = size / Math.max(width, height);
  const corner = (x: number, y: number): Vector => [x * width * k, y * height * k, 1.6 * size];
  return [[0, 0, 0], corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
}

function worldOf(markers: Vector[], cameras: SceneCamera[], poses: Transform[], part: number): World {
  const centres = poses.flatMap((T) => cameras.map((camera) => apply(T, apply(camera.T_rig_camera, [0, 0, 0]))));
  const { middle, radius } = extentOf([...markers, ...centres]);
  const size = part * radius;
  const rig = cameras.map((camera) => pyramidOf(camera.image_size, size).map((p) => apply(camera.T_rig_camera, p)));
  return { middle, radius, markers, outline: outlineOf(markers), axes: 4 * size, pyramids: poses.map((T) => rig.map((points) => points.map((p) => apply(T, p)))) };
}

export const wholeWorld = (markers: Vector[], cameras: SceneCamera[], frames: ScenePose[]): World =>
  worldOf(markers, cameras, frames.map((frame) => frame.T_target_rig), 0.035);

/** The cameras alone, as they stand to each other. */
export function rigWorld(cameras: SceneCamera[]): World {
  const world = worldOf([], cameras, [kStill], 0.25);
  return { ...world, axes: 0.3 * world.radius };
}

export interface Turn {
  yaw: number;
  pitch: number;
  zoom: number;
  /** Radii. */
  shift: [number, number];
}

export type Projection = (p: Vector) => [number, number];

/** Perspective of an eye at 3.5 radii. */
export function projectionOf({ middle, radius }: World, { yaw, pitch, zoom, shift }: Turn, width: number, height: number): Projection {
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  const scale = ((0.5 * Math.min(width, height)) / radius) * zoom;
  return (p) => {
    const [x, y, z] = [p[0] - middle[0], p[1] - middle[1], p[2] - middle[2]];
    const [u, d] = [cy * x + sy * z, cy * z - sy * x];
    const f = (3.5 * radius) / (3.5 * radius + sp * y + cp * d);
    return [width / 2 + scale * (u * f - shift[0] * radius), height / 2 + scale * ((cp * y - sp * d) * f - shift[1] * radius)];
  };
}

export type Side = Pick<Turn, "yaw" | "pitch">;

/** Zoom and shift by which all of the world and of the ghosts fills the window. */
export function fitted(world: World, ghosts: Ghost[], { yaw, pitch }: Side, width: number, height: number): Turn {
  const plain: Turn = { yaw, pitch, zoom: 1, shift: [0, 0] };
  const project = projectionOf(world, plain, width, height);
  const apexes = ghosts.map(({ T_target_camera }) => apply(T_target_camera, [0, 0, 0]));
  const points = [...world.markers, ...world.pyramids.flat(2), ...apexes].map(project);
  if (points.length === 0) return plain;
  const low = (k: 0 | 1): number => points.reduce((least, p) => Math.min(least, p[k]), Infinity);
  const high = (k: 0 | 1): number => points.reduce((most, p) => Math.max(most, p[k]), -Infinity);
  const half = 0.5 * Math.min(width, height);
  return {
    yaw,
    pitch,
    zoom: 0.92 * Math.min(width / (high(0) - low(0) || 1), height / (high(1) - low(1) || 1)),
    shift: [(low(0) + high(0) - width) / 2 / half, (low(1) + high(1) - height) / 2 / half],
  };
}
