// SPDX-License-Identifier: Apache-2.0
// All images with what was found in them, while it is found.
import { Thumb } from "../parts/picture";
import { Upload } from "../parts/upload";
import { attempt, detections, go, loadState, run, ruleOf, session } from "../state/project";

function words(camera: string, frame: string): { text: string; bad: boolean } {
  const rule = ruleOf(camera, frame);
  if (rule) return { text: rule.note ? `excluded: ${rule.note}` : "excluded", bad: true };
  const found = detections.value[`${camera}/${frame}`];
  if (found) return { text: found.points > 0 ? `${found.points} points` : found.why || "no target", bad: found.points === 0 };
  const result = run.value?.cameras.find((each) => each.name === camera)?.frames.find((each) => each.frame === frame);
  if (result) return { text: `${result.points} points, ${result.rms?.toFixed(2) ?? "-"} px`, bad: false };
  // Lines of left_out begin with the file.
  const why = run.value?.left_out.find((line) => line.includes(`/${frame}.`) || line.includes(`frame ${frame}:`));
  return why ? { text: why.slice(why.indexOf(": ") + 2), bad: true } : { text: "not looked at yet", bad: false };
}

export function Images() {
  const cameras = session.value?.cameras ?? [];
  if (cameras.length === 0) return <p>No session yet: go to Set up.</p>;
  const found = Object.values(detections.value);
  return (
    <>
      <Upload cameras={cameras} done={() => attempt(loadState)} />
      {found.length > 0 && (
        <p aria-live="polite">
          {found.length} images looked at, target found in {found.filter((each) => each.points > 0).length}
        </p>
      )}
      {cameras.map((camera) => (
        <section key={camera.name}>
          <h2>
            {camera.name}: {camera.frames.length} images
          </h2>
          <div class="grid">
            {camera.frames.map((frame) => {
              const { text, bad } = words(camera.name, frame);
              return (
                <button key={frame} class="card" onClick={() => go("results", [camera.name, frame])}>
                  <Thumb camera={camera.name} frame={frame} />
                  <b>{frame}</b>
                  <span class={bad ? "bad" : ""}>{text}</span>
                </button>
              );
            })}
          </div>
        </section>
      ))}
    </>
  );
}
