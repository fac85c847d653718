// SPDX-License-Identifier: Apache-2.0
// Data of the pages that the program writes (apps/report, apps/scene/loop, apps/photometry).
import type { Parameter, SigmaMap, Transform, Verdict } from "../api/types";
import type { Field, Grid, Size } from "../plot/image_field";
import type { Vector } from "../space/geometry";

type Unknown = number | null;

export interface FieldRms extends Field {
  rms: Unknown[];
}
/** Sums over the used points of each frame, marker or lens type. */
export interface Sums {
  points: number[];
  rejected: number[];
  rms: Unknown[];
}
/** Every `step`-th point; frame: index into the frames. */
export interface Sample {
  all: number;
  step: number;
  x: number[];
  y: number[];
  dx: number[];
  dy: number[];
  used: number[];
  frame: number[];
  marker: number[];
  depth: number[];
}
export interface Plots {
  sample: Sample;
  field: FieldRms;
  histogram: { sigmas: number[]; counts: number[]; expected: number[]; noise_left: number; outside: number; coordinates: number };
  frames: Sums & { frame: number[] };
  markers: Sums & { marker: number[] };
  types: Sums & { type: number[] };
  depth: { middles?: number[]; counts?: number[] };
}
export interface Fit {
  points: number;
  rejected: number;
  views: number;
  rms: Unknown;
  noise: Unknown;
  detector_sigma?: Unknown;
}
export interface LensType {
  type: number;
  focal_length: number;
  focal_length_sigma: Unknown;
  aperture: number;
  aperture_sigma: Unknown;
  in_focus: Unknown;
  near: Unknown;
  far: Unknown;
  distance: number[];
  disc: Unknown[];
}
export interface Section {
  step: number;
  values: number[];
}
export interface Vignetting extends Grid {
  values: Unknown[];
  row: Section;
  column: Section;
  detail?: { first: number; values: number[] };
}
export interface MicroLenses extends Field {
  lenses: number;
  types: { type: number; lenses: number }[];
  pitch: number;
  rms: number;
}
export interface ReportCamera {
  name: string;
  model: string;
  source: string;
  image_size: [number, number];
  parameters: Parameter[];
  coefficients: number;
  summary: string;
  T_rig_camera: Transform;
  /** Empty of the camera that is the rig's frame. */
  T_camera_rig: Parameter[];
  residuals: Fit;
  /** Name, value, unit. */
  residual_table: [string, Unknown, string][];
  plots: Plots;
  projection: SigmaMap[];
  distance: { distance: number[]; calibration: Unknown[]; noise: Unknown[] };
  lens_types: LensType[];
  /** Empty where there is none. */
  vignetting: Partial<Vignetting>;
  micro_lenses: Partial<MicroLenses>;
  sample: { frame: string; pictures: { picture?: string; depth?: string } };
}
export interface Marker {
  number: number;
  place: Vector;
  moved?: Vector;
  sigma?: Vector;
}
export interface Sightings {
  targets: string[];
  /** By camera and target, frames. */
  seen: number[][];
  common: number[][];
}
export interface Calibration {
  kind: "calibration";
  verdict: Verdict;
  cameras: ReportCamera[];
  frames: { name: string; T_target_rig: Transform }[];
  markers: Marker[];
  marker_tolerance: number;
  scene: boolean;
  sightings: Partial<Sightings>;
  correlation: { names: string[]; below_diagonal: number[][] };
  left_out: string[];
  provenance: [string, string][];
}

export interface TrialModel {
  model: string;
  /** Why it has no score; empty when it has one. */
  why_not: string;
  recommended: boolean;
  judgement: string;
  undetermined: string[];
  parameters?: number;
  rms?: number;
  rms_sigma?: Unknown;
  probability?: Unknown;
  in_sample_rms?: Unknown;
  difference?: Unknown;
  sigma?: Unknown;
  image_sigma?: Unknown;
}
export interface Trial {
  kind: "trial";
  recommendation: string;
  target: string;
  frames: number;
  folds: number;
  points: number;
  outliers: number;
  models: TrialModel[];
  cameras: { name: string; image_size: Size; fields: { model: string; field: FieldRms }[] }[];
}

export interface Segment {
  frames: string[];
  left_out: number;
  extent: Vector;
  path: Vector[];
}
export interface LoopTruth {
  kind: "truth";
  headline: string;
  findings: string[];
  cameras: { name: string; image_size: [number, number]; rms: number; T_rig_camera: Transform }[];
  frames: { name: string; T_target_rig: Transform; observations: number; common: number; rms: number; position_sigma: number }[];
  markers: { place: Vector; common: boolean }[];
  truth: {
    points: number;
    common: number;
    observations: number;
    floors: [number, number][];
    segments: Record<"start" | "end", Segment>;
  };
}

export interface Response {
  U: number[];
  sigma: Unknown[];
  count: number[];
  gain: number;
  read: number;
  rms: number;
  pixels: number;
  moving: number;
  exposure_sigma: number;
  frames: string[];
  exposures: number[];
  exposure_errors: number[];
}
interface Cells extends Grid {
  values: number[];
}
interface Profile {
  values: number[];
  sigma: number[];
}
export interface Vignette {
  image_size: Size;
  row: Profile;
  column: Profile;
  attenuation: Cells;
  sigma: Cells;
  measurements: number;
  residual: number;
  expected: number;
  outliers: number;
  frames: string[];
  gains: number[];
  angles: number[];
  by_angle: number[];
  wall: Cells;
}
export interface AttenuationRows {
  x: number[];
  first: number[];
  second: number[];
  sigma: Unknown[];
}
export interface Comparison {
  first: string;
  second: string;
  rms: number;
  largest: number;
  row: AttenuationRows;
  radial: AttenuationRows;
}
export interface Photometry {
  kind: "photometry";
  camera: string;
  headline: string;
  findings: string[];
  response?: Response;
  vignette?: Vignette;
  comparison?: Comparison;
}

export type PageData = Calibration | Trial | LoopTruth | Photometry;
