// SPDX-License-Identifier: Apache-2.0
// A bar a frame, as buttons: RMS of its points, or its influence on the result. Excluded frames are hatched.
import type { CameraResult, Influence } from "../api/types";
import { ruleOf, session } from "../state/project";

export type Order = "name" | "rms" | "influence";

interface Bars {
  camera: CameraResult;
  selected: string;
  order: Order;
  influences: Influence[];
  onSelect: (frame: string) => void;
}

interface Bar {
  frame: string;
  size: number | null;
  words: string;
}

function barsOf({ camera, order, influences }: Bars): Bar[] {
  const influence = new Map(influences.map((each) => [each.frame, each]));
  const bars = camera.frames.map(({ frame, points, rejected, rms }) => {
    const of = influence.get(frame);
    const moved = of?.sigmas ? `; without it ${of.unknown} changes by ${of.sigmas.toPrecision(2)} sigma` : "";
    return {
      frame,
      size: order === "influence" ? (of?.sigmas ?? null) : rms,
      words: `${rms?.toFixed(3) ?? "-"} px, ${points} points, ${rejected} rejected${moved}`,
    };
  });
  // Excluded frames that this run did not see keep their place, to be included again.
  const known = new Set(camera.frames.map((frame) => frame.frame));
  const left = (session.value?.cameras.find((each) => each.name === camera.name)?.frames ?? [])
    .filter((frame) => !known.has(frame) && ruleOf(camera.name, frame))
    .map((frame) => ({ frame, size: null, words: "excluded" }));
  const all = [...bars, ...left].sort((a, b) => a.frame.localeCompare(b.frame, "en", { numeric: true }));
  return order === "name" ? all : all.sort((a, b) => (b.size ?? 0) - (a.size ?? 0));
}

export function FrameBars(bars: Bars) {
  const { camera, selected, order, onSelect } = bars;
  const shown = barsOf(bars);
  const most = Math.max(1e-9, ...shown.map((bar) => bar.size ?? 0));
  return (
    <div class="bars" role="group" aria-label={`${order === "influence" ? "influence" : "RMS"} of the frames of ${camera.name}`}>
      {shown.map(({ frame, size, words }) => (
        <button
          key={frame}
          class={`bar ${frame === selected ? "chosen" : ""} ${ruleOf(camera.name, frame) ? "hatched" : ""}`}
          title={`${frame}: ${words}`}
          aria-label={`${frame}: ${words}`}
          aria-pressed={frame === selected}
          onClick={() => onSelect(frame)}
        >
          <span style={`height: ${size === null ? 100 : (100 * size) / most}%`} />
        </button>
      ))}
    </div>
  );
}
