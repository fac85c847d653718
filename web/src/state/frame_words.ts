// SPDX-License-Identifier: Apache-2.0
// What became of an image, in words.
import { detections, ruleOf, run } from "./project";

export interface FrameWords {
  text: string;
  /** It is not in the result. */
  bad: boolean;
}

export function wordsOfFrame(camera: string, frame: string): FrameWords {
  const rule = ruleOf(camera, frame);
  if (rule) return { text: rule.note ? `excluded: ${rule.note}` : "excluded", bad: true };
  const found = detections.value[`${camera}/${frame}`];
  if (found) return { text: found.points > 0 ? `${found.points} points` : found.why || "no target", bad: found.points === 0 };
  const result = run.value?.cameras.find((each) => each.name === camera)?.frames.find((each) => each.frame === frame);
  if (result) return { text: `${result.points} points, ${result.rms?.toFixed(2) ?? "-"} px`, bad: false };
  // Lines of left_out begin with the file.
  const why = run.value?.left_out.find(
    (line) => line.includes(`${camera}/${frame}.`) || line.includes(`/${frame}.`) || line.includes(`frame ${frame}:`),
  );
  return why ? { text: why.slice(why.indexOf(": ") + 2), bad: true } : { text: "not looked at yet", bad: false };
}
