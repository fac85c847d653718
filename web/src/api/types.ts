// SPDX-License-Identifier: Apache-2.0
// Answers of the server (apps/workbench/api.cc, run_json.cc).

export interface Job {
  id: number;
  kind: string;
  command: string;
  state: "waiting" | "running" | "done" | "failed" | "stopped";
  stage?: string;
  done?: number;
  total?: number;
  error?: string;
  run?: number;
}
export interface RunBrief {
  run: number;
  grade?: string;
  rms?: (number | null)[];
  problem?: string;
}
export interface State {
  root: string;
  session: { path: string; hash: string; undo: boolean; redo: boolean } | null;
  jobs: Job[];
  runs: RunBrief[];
  watching: boolean;
  event: number;
}
export interface Rule {
  camera: string;
  frame: string;
  markers: number[];
  note: string;
}
export interface SessionCamera {
  name: string;
  model: string;
  plenoptic: boolean;
  frames: string[];
  /** That its images are all PNG files of; null: they come from elsewhere. */
  folder: string | null;
}
export interface Session {
  text: string;
  hash: string;
  undo: boolean;
  redo: boolean;
  cameras: SessionCamera[];
  exclude: Rule[];
  target: string | null;
  target_text: string | null;
  problem: string | null;
}
export interface Files {
  dir: string;
  images: number;
  entries: { name: string; kind: string; count: number }[];
}
export interface Detection {
  camera: string;
  frame: string;
  points: number;
  why: string;
}
export interface Finding {
  code: string;
  grade: string;
  what: string;
  remedy: string;
}
export interface Verdict {
  grade: string;
  headline: string;
  findings: Finding[];
}
/** sigma: null where the images leave the parameter open, 0 where it is fixed. */
export interface Parameter {
  name: string;
  unit: string;
  value: number;
  sigma: number | null;
}
export interface FrameResult {
  frame: string;
  points: number;
  rejected: number;
  rms: number | null;
}
export interface CameraResult {
  name: string;
  model: string;
  plenoptic: boolean;
  image_size: [number, number];
  parameters: Parameter[];
  rms: number | null;
  noise: number | null;
  detector_sigma: number | null;
  points: number;
  rejected: number;
  frames: FrameResult[];
}
export interface Run {
  run: number;
  verdict: Verdict;
  cameras: CameraResult[];
  left_out: string[];
  folder: string;
}
/** Of `plenocal try`, best model first. */
export interface Tried {
  cameras: string[];
  frames: number | null;
  folds: number | null;
  recommended: string | null;
  why: string | null;
  target: string | null;
  models: {
    name: string;
    parameters: number | null;
    held_out_rms: number | null;
    held_out_sigma: number | null;
    image_sigma: number | null;
    judgement: string | null;
    failure: string | null;
  }[];
}
/** By how many standard errors the result changes without a frame, and what changes most. */
export interface Influence {
  frame: string;
  sigmas: number | null;
  unknown: string;
}
/** Marker, x, y, dx, dy, used. */
export type Point = [number, number, number, number | null, number | null, number];
/** Rows of [R t]. */
export type Transform = number[];
export interface Space {
  markers: [number, number, number][];
  /** From the nominal positions, m; empty: the markers were not refined. */
  displacements: [number, number, number][];
  cameras: { name: string; T_rig_camera: Transform; image_size: [number, number] }[];
  frames: { name: string; T_target_rig: Transform }[];
}
export interface SigmaMap {
  distance: number;
  columns: number;
  rows: number;
  sigma: (number | null)[];
}
export interface Suggestions {
  sigma_now: number | null;
  goal: number;
  reached: boolean;
  exhausted: boolean;
  frames: number;
  views: {
    words: string;
    camera: string;
    cameras: string[];
    /** Rows of a 4 x 4 matrix. */
    T_camera_target: number[][];
    outline: Record<string, [number, number][][]>;
    sigma_after: number | null;
  }[];
}
/** Over an image; null: no points. */
export interface ImageField {
  columns: number;
  rows: number;
  points: number[];
  mean_x: (number | null)[];
  mean_y: (number | null)[];
  rms: (number | null)[];
}
/** Two runs, as `plenocal compare` has it, and by how much a camera's images differ, px; a distance of null: far away. */
export interface Comparison {
  command: string;
  text: string;
  maps: {
    camera: string;
    image_size: [number, number];
    distance: number | null;
    rms: number | null;
    predicted: number | null;
    differs: boolean;
    field: ImageField;
  }[];
}
/** Residuals of a camera by marker, and their means over the image. */
export interface Residuals {
  markers: { marker: number; points: number; rejected: number; rms: number; worst: string }[];
  field: ImageField;
}
/** A run without what the session leaves out by now: before and after, px; largest change, sigmas. */
export interface Preview {
  points: number;
  rms: [number, number];
  sigma: [number | null, number | null];
  sigmas: number | null;
  unknown: string;
}
/** What pictures add to a run; sigmas in px. `share`: of the gain of the best view; null: no pose. */
export interface Worth {
  points: number;
  words: string;
  sigma_now: number | null;
  sigma_after: number | null;
  share: number | null;
}
/** Micro-image centres (x, y, lens type) of a plenoptic camera, raw px. */
export interface Lenses {
  pitch: number;
  centres: [number, number, number][];
}
/** Totally focused image: pixel p lies at raw pixel offset + scale * p. `depth`: every `step`-th of its pixels. */
export interface Focus {
  offset: [number, number];
  scale: number;
  size: [number, number];
  step: number;
  columns: number;
  rows: number;
  depth: (number | null)[];
}
