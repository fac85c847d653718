// SPDX-License-Identifier: Apache-2.0
// Answers of the server (apps/workbench/api.cc) beside those of calibration.ts, which the build makes from engine/json/calibration.schema.json.
import type { Difference } from "./calibration";

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
  models?: string[];
  projection?: number; // error of the projection that the verdict judges, px; of the worst camera
  problem?: string;
}
export interface State {
  root: string;
  session: { path: string; hash: string; undo: boolean; redo: boolean } | null;
  jobs: Job[];
  runs: RunBrief[];
  watching: boolean;
  /** Of files for other programs. */
  formats: string[];
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
/** What a form shows of the value of a key in the text of session or target. */
export interface Field {
  path: string[];
  value: string;
  what: string;
  unit: string;
  required: boolean;
  /** Empty: any value. */
  choices: string[];
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
  fields: Record<"session" | "target", Field[]>;
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
/** try.yaml (docs/formats.md), best model first; null: infinite. */
export interface Tried {
  cameras: string[];
  frames: number;
  folds: number;
  recommended: string;
  why: string;
  target?: { why?: string };
  models: Record<
    string,
    {
      parameters?: number;
      held_out?: { rms: number; sigma: number };
      projection?: number | null;
      judgement?: string;
      failure?: string;
    }
  >;
}
/** By how many standard errors the result changes without a frame, and what changes most. */
export interface Influence {
  frame: string;
  sigmas: number | null;
  unknown: string;
}
/** Marker, x, y, dx, dy, used. */
export type Point = [number, number, number, number | null, number | null, number];
export interface Suggestions {
  sigma_now: number | null;
  goal: number;
  reached: boolean;
  exhausted: boolean;
  /** What the best choice of views could reach; null: something is not determined. */
  bound: { words: string } | null;
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
/** After a picture that was kept: what follows for all of them, and how long that took after its detection. */
export interface Renewed extends Suggestions {
  seconds: number;
  detection_seconds: number;
  calibration: Record<string, { coverage: number; parameters: [string, number, number | null][] }>;
}
/** Two runs, in the words of `plenocal compare` and over the images. */
export interface Comparison {
  command: string;
  text: string;
  maps: Difference[];
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
