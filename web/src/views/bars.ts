// SPDX-License-Identifier: Apache-2.0
// The frames of a camera as bars: RMS of their points, or their influence on the result.
import type { Influence } from "../api/types";
import type { CameraResult } from "../base/calibration";
import type { FrameBar } from "../plot/frame_bars";
import { ruleOf, session } from "../state/project";

export type Order = "name" | "rms" | "influence";

export interface Ordered {
  camera: CameraResult;
  order: Order;
  influences: Influence[];
}

export function barsOf({ camera, order, influences }: Ordered): FrameBar[] {
  const influence = new Map(influences.map((each) => [each.frame, each]));
  const bars = camera.frames.map(({ frame, points, rejected, rms }): FrameBar => {
    const of = influence.get(frame);
    const moved = of?.sigmas ? `; without it ${of.unknown} changes by ${of.sigmas.toPrecision(2)} sigma` : "";
    return {
      name: frame,
      size: order === "influence" ? (of?.sigmas ?? null) : rms,
      words: `${rms?.toFixed(3) ?? "-"} px, ${points} points, ${rejected} rejected${moved}`,
      excluded: ruleOf(camera.name, frame) !== undefined,
    };
  });
  // Excluded frames that this run did not see keep their place, to be included again.
  const known = new Set(camera.frames.map((frame) => frame.frame));
  const left = (session.value?.cameras.find((each) => each.name === camera.name)?.frames ?? [])
    .filter((frame) => !known.has(frame) && ruleOf(camera.name, frame))
    .map((frame): FrameBar => ({ name: frame, size: null, words: "excluded", excluded: true }));
  const all = [...bars, ...left].sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true }));
  return order === "name" ? all : all.sort((a, b) => (b.size ?? 0) - (a.size ?? 0));
}
