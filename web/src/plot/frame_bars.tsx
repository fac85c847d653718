// SPDX-License-Identifier: Apache-2.0
// A bar a frame, as buttons: RMS of its points. Excluded frames are hatched.
import type { CameraResult } from "../api/types";
import { ruleOf, session } from "../state/project";

interface Bars {
  camera: CameraResult;
  selected: string;
  order: "name" | "rms";
  onSelect: (frame: string) => void;
}

export function FrameBars({ camera, selected, order, onSelect }: Bars) {
  // Excluded frames that this run did not see keep their place, to be included again.
  const known = new Set(camera.frames.map((frame) => frame.frame));
  const left = (session.value?.cameras.find((each) => each.name === camera.name)?.frames ?? [])
    .filter((frame) => !known.has(frame) && ruleOf(camera.name, frame))
    .map((frame) => ({ frame, points: 0, rejected: 0, rms: null }));
  const frames = [...camera.frames, ...left].sort((a, b) => a.frame.localeCompare(b.frame, "en", { numeric: true }));
  if (order === "rms") frames.sort((a, b) => (b.rms ?? 0) - (a.rms ?? 0));
  const most = Math.max(1e-9, ...frames.map((frame) => frame.rms ?? 0));
  return (
    <div class="bars" role="group" aria-label={`RMS of the frames of ${camera.name}`}>
      {frames.map((frame) => (
        <button
          key={frame.frame}
          class={`bar ${frame.frame === selected ? "chosen" : ""} ${ruleOf(camera.name, frame.frame) ? "hatched" : ""}`}
          title={`${frame.frame}: ${frame.rms?.toFixed(3) ?? "-"} px, ${frame.points} points, ${frame.rejected} rejected`}
          aria-label={`${frame.frame} ${frame.rms?.toFixed(3) ?? "no"} px`}
          aria-pressed={frame.frame === selected}
          onClick={() => onSelect(frame.frame)}
        >
          <span style={`height: ${frame.rms === null ? 100 : (100 * frame.rms) / most}%`} />
        </button>
      ))}
    </div>
  );
}
