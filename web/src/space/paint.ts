// SPDX-License-Identifier: Apache-2.0
// A scene on a 2D canvas, which also works where there is no WebGL.
import { brief } from "../base/numbers";
import { lineRamp, seriesName, styled } from "../plot/colours";
import { apply, projectionOf, pyramidOf } from "./geometry";
import type { Ghost, Projection, SceneCamera, Turn, Vector, World } from "./geometry";

export interface Shown {
  world: World;
  cameras: SceneCamera[];
  /** What stands beside the optical centres: the cameras' names, of the rig alone; or those of the frames. */
  named: "cameras" | "frames" | null;
  frames: string[];
  ghosts: Ghost[];
  /** Of the markers, from their nominal positions, m; drawn `magnify` times as long. */
  displacements: Vector[];
  magnify: number;
  turn: Turn;
  /** RMS of a pose's camera, px, for its colour; null: a colour a camera. */
  rms: ((pose: number, camera: number) => number | null) | null;
  /** The pose that stands out; -1: all alike. */
  pose: number;
  hover: Place | null;
  /** Every k-th pose is drawn. */
  every: number;
}

/** Optical centre of a camera on the canvas. */
export interface Place {
  pose: number;
  camera: number;
  x: number;
  y: number;
}

export const kRmsScale: [number, number] = [0.05, 1]; // px, logarithmic
const kSteps = 16;

/** A few colours, so that few paths are drawn. */
function colourOf(rms: number | null): string {
  if (rms === null || !(rms > 0)) return styled("--line");
  const part = Math.log(rms / kRmsScale[0]) / Math.log(kRmsScale[1] / kRmsScale[0]);
  return lineRamp(Math.round(kSteps * Math.min(1, Math.max(0, part))) / kSteps);
}

function addPyramid(path: Path2D, points: Vector[], project: Projection): [number, number] {
  const [apex = [0, 0], ...base] = points.map(project);
  base.forEach((corner, i) => {
    path.moveTo(apex[0], apex[1]);
    path.lineTo(...corner);
    path.lineTo(...(base[(i + 1) % base.length] ?? corner));
  });
  return apex as [number, number];
}

function paintAxes(canvas: CanvasRenderingContext2D, length: number, project: Projection): void {
  const ends: [string, string, Vector][] = [["x", "--bad", [length, 0, 0]], ["y", "--good", [0, length, 0]], ["z", "--series-0", [0, 0, length]]];
  canvas.lineWidth = 2;
  for (const [name, colour, end] of ends) {
    canvas.strokeStyle = canvas.fillStyle = styled(colour);
    canvas.beginPath();
    canvas.moveTo(...project([0, 0, 0]));
    canvas.lineTo(...project(end));
    canvas.stroke();
    canvas.fillText(name, ...project(end));
  }
}

function paintPoses(canvas: CanvasRenderingContext2D, shown: Shown, poses: number[], project: Projection): Place[] {
  const paths = new Map<string, Path2D>();
  const rigs = new Path2D();
  const places: Place[] = [];
  const cameraColours = shown.cameras.map((_, camera) => styled(seriesName(camera)));
  for (const pose of poses) {
    shown.world.pyramids[pose]?.forEach((points, camera) => {
      const colour = shown.rms ? colourOf(shown.rms(pose, camera)) : (cameraColours[camera] ?? "");
      const path = paths.get(colour) ?? new Path2D();
      paths.set(colour, path);
      const [x, y] = addPyramid(path, points, project);
      places.push({ pose, camera, x, y });
      if (camera === 0) rigs.moveTo(x, y);
      else rigs.lineTo(x, y);
    });
  }
  for (const [colour, path] of paths) {
    canvas.strokeStyle = colour;
    canvas.stroke(path);
  }
  canvas.strokeStyle = styled("--quiet");
  if (shown.cameras.length > 1) canvas.stroke(rigs);
  return places;
}

function paintGhosts(canvas: CanvasRenderingContext2D, { ghosts, world, cameras }: Shown, project: Projection): void {
  if (ghosts.length === 0) return;
  const shape = pyramidOf(cameras[0]?.image_size ?? [4, 3], 0.06 * world.radius);
  canvas.save();
  canvas.strokeStyle = canvas.fillStyle = styled("--accent");
  canvas.lineWidth = 1.5;
  canvas.setLineDash([5, 4]);
  for (const { name, T_target_camera } of ghosts) {
    const path = new Path2D();
    const [x, y] = addPyramid(path, shape.map((p) => apply(T_target_camera, p)), project);
    canvas.stroke(path);
    canvas.fillText(name, x + 5, y - 5);
  }
  canvas.restore();
}

/** Around the markers of a flat target. */
function paintOutline(canvas: CanvasRenderingContext2D, outline: Vector[], project: Projection): void {
  canvas.beginPath();
  for (const corner of outline) canvas.lineTo(...project(corner));
  canvas.closePath();
  canvas.strokeStyle = styled("--quiet");
  canvas.lineWidth = 1;
  canvas.stroke();
}

const kBar = 140; // px, at most

/** A bar of a round length, at the distance of the scene's middle. Returns its words. */
function paintScale(canvas: CanvasRenderingContext2D, pixelsPerMetre: number, height: number): string {
  const power = 10 ** Math.floor(Math.log10(kBar / pixelsPerMetre));
  const length = ([5, 2].find((step) => step * power * pixelsPerMetre <= kBar) ?? 1) * power;
  const words = length >= 1 ? `${brief(length)} m` : `${brief(1e3 * length)} mm`;
  const [left, right, y] = [12, 12 + length * pixelsPerMetre, height - 12];
  canvas.strokeStyle = canvas.fillStyle = styled("--text");
  canvas.lineWidth = 1.5;
  canvas.beginPath();
  for (const x of [left, right]) {
    canvas.moveTo(x, y - 4);
    canvas.lineTo(x, y + 4);
  }
  canvas.moveTo(left, y);
  canvas.lineTo(right, y);
  canvas.stroke();
  canvas.fillText(words, left + 4, y - 6);
  return words;
}

/** From where each marker should be. */
function paintDisplacements(canvas: CanvasRenderingContext2D, { world, displacements, magnify }: Shown, project: Projection): void {
  if (magnify === 0) return;
  const path = new Path2D();
  displacements.forEach(([x, y, z], i) => {
    const [u, v, w] = world.markers[i] ?? [0, 0, 0];
    path.moveTo(...project([u - x, v - y, w - z]));
    path.lineTo(...project([u + (magnify - 1) * x, v + (magnify - 1) * y, w + (magnify - 1) * z]));
  });
  canvas.strokeStyle = styled("--series-1");
  canvas.lineWidth = 1.5;
  canvas.stroke(path);
}

/** Returns where the cameras are. */
export function paintScene(element: HTMLCanvasElement, shown: Shown): Place[] {
  const canvas = element.getContext("2d");
  const [width, height] = [element.clientWidth, element.clientHeight];
  if (!canvas || width === 0) return [];
  const dots = window.devicePixelRatio || 1;
  element.width = width * dots;
  element.height = height * dots;
  canvas.setTransform(dots, 0, 0, dots, 0, 0);
  canvas.font = "12px system-ui, sans-serif";
  const { world, pose, every, hover } = shown;
  const project = projectionOf(world, shown.turn, width, height);
  canvas.fillStyle = styled("--text");
  for (const marker of world.markers) {
    const [x, y] = project(marker);
    canvas.fillRect(x - 1, y - 1, 2, 2);
  }
  paintOutline(canvas, world.outline, project);
  paintDisplacements(canvas, shown, project);
  paintAxes(canvas, world.axes, project);
  const all = world.pyramids.map((_, i) => i).filter((i) => i % every === 0);
  canvas.globalAlpha = pose < 0 ? 1 : 0.15;
  canvas.lineWidth = 1;
  const places = paintPoses(canvas, shown, all, project);
  canvas.globalAlpha = 1;
  canvas.lineWidth = 2;
  if (pose >= 0) paintPoses(canvas, shown, [pose], project);
  paintGhosts(canvas, shown, project);
  const { named } = shown;
  canvas.fillStyle = styled(named === "cameras" ? "--text" : "--quiet");
  for (const { pose, camera, x, y } of named ? places : []) {
    if (named === "cameras") canvas.fillText(shown.cameras[camera]?.name ?? "", x + 6, y + 14);
    else if (camera === 0) canvas.fillText(shown.frames[pose] ?? "", x + 6, y + 4);
  }
  element.dataset.scale = paintScale(canvas, ((0.5 * Math.min(width, height)) / world.radius) * shown.turn.zoom, height);
  const at = hover && places.find((place) => place.pose === hover.pose && place.camera === hover.camera);
  if (at) {
    canvas.strokeStyle = styled("--accent");
    canvas.strokeRect(at.x - 7, at.y - 7, 14, 14);
  }
  return places;
}
