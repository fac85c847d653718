// SPDX-License-Identifier: Apache-2.0
// The JSON of a calibration (api/calibration.ts, made from its schema) in the forms that components take.
import type { Camera, Parameter, Run, RunCamera, Space, Vector } from "../api/calibration";

/** The rig's master first. */
export const camerasOf = <C extends Camera>({ cameras }: { cameras: Record<string, C> }): C[] =>
  Object.values(cameras).sort((a, b) => a.index - b.index);

/** Those of the model's equations, in its order. */
export const parametersOf = ({ units, parameters, sigma }: Camera): Parameter[] =>
  units.map(([name, unit]) => ({ name, unit, value: parameters[name] ?? NaN, sigma: sigma[name] ?? null }));

type Row<C> = { [K in keyof C]: C[K] extends readonly (infer T)[] ? T : never };

/** Rows of columns of the same length. */
export function rowsOf<C extends object>(columns: C): Row<C>[] {
  const named = Object.entries(columns) as [string, unknown[]][];
  return (named[0]?.[1] ?? []).map((_, i) => Object.fromEntries(named.map(([name, values]) => [name, values[i]])) as Row<C>);
}

export type FrameResult = Row<RunCamera["frames"]>;
export interface CameraResult extends Omit<RunCamera, "frames"> {
  frames: FrameResult[];
}
export interface RunResult extends Omit<Run, "cameras"> {
  cameras: CameraResult[];
}

export const resultOf = (run: Run): RunResult => ({
  ...run,
  cameras: camerasOf(run).map((camera) => ({ ...camera, frames: rowsOf(camera.frames) })),
});

/** What a scene in space shows of the target and of the frames. */
export function targetOf({ markers, poses }: Space) {
  const none: Vector = [0, 0, 0];
  return {
    markers: markers.map(({ place }) => place),
    displacements: markers.some(({ moved }) => moved) ? markers.map(({ moved }) => moved ?? none) : [],
    frames: poses,
  };
}
