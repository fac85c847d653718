// SPDX-License-Identifier: Apache-2.0
// Data of the pages that the program writes (apps/report, apps/groundtruth, apps/photometry) beside those of a calibration.
import type { Accuracy, AccuracyAtDistance, Field, Report, Transform } from "../api/calibration";
import type { Grid, Size } from "../plot/image_field";
import type { Vector } from "../space/geometry";

type Unknown = number | null;

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
  projection?: Unknown;
}
/** A calibration from a part of the points against the others. */
export interface StressTest {
  camera: string;
  what: string;
  /** Why it has no numbers; empty when it has them. */
  failure: string;
  fails: boolean;
  probability?: number;
  difference?: number;
  predicted?: number;
  factor?: number;
}
export interface Trial {
  kind: "trial";
  recommendation: string;
  target: string;
  /** What the residuals of the recommended model contain, in sentences; may be empty. */
  evidence: string;
  frames: number;
  folds: number;
  points: number;
  outliers: number;
  models: TrialModel[];
  /** Of the recommended model; empty where not asked for. */
  stress: StressTest[];
  cameras: { name: string; image_size: Size; fields: { model: string; field: Field }[] }[];
}

export interface MappedAccuracy extends Accuracy {
  distances: (AccuracyAtDistance & { map: Grid & { sigma: Unknown[] } })[];
}
export interface AcceptancePageData {
  kind: "acceptance";
  passes: boolean;
  lacks: string[];
  left_out: string[];
  findings: { what: string; remedy: string }[];
  lengths: number;
  lines: number;
  volume: Vector;
  largest: number;
  rms: number;
  measured: {
    line: string;
    of: string;
    frame: string;
    reference: number;
    measured: number;
    sigma: number;
    deviation: number;
    limit: number;
  }[];
}
export interface AccuracyPageData {
  kind: "accuracy";
  accuracy: MappedAccuracy[];
  image_sizes: Record<string, Size>;
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

export type PageData = Report | Trial | LoopTruth | Photometry | AccuracyPageData | AcceptancePageData;
