// SPDX-License-Identifier: Apache-2.0
// All images with what was found in them, while it is found; one that is in no result is shown with the reason.
import { imagePath } from "../api/client";
import { Plane } from "../image/plane";
import { Thumb, useImage } from "../parts/picture";
import { Upload } from "../parts/upload";
import { wordsOfFrame } from "../state/frame_words";
import { attempt, detections, go, loadState, place, run, session } from "../state/project";

const inRun = (camera: string, frame: string): boolean =>
  run.value?.cameras.find((each) => each.name === camera)?.frames.some((each) => each.frame === frame) ?? false;

function Refused({ camera, frame }: { camera: string; frame: string }) {
  const picture = useImage(imagePath(camera, frame, 0));
  const { text, bad } = wordsOfFrame(camera, frame);
  return (
    <section data-shown={`${camera}/${frame}`}>
      <div class="row">
        <button onClick={() => go("images")}>all images</button>
        <h2>
          {camera} / {frame}
        </h2>
      </div>
      <p class={bad ? "problem" : ""}>{text}</p>
      {picture && <Plane name={`${camera} ${frame}`} picture={picture} size={[picture.naturalWidth, picture.naturalHeight]} />}
    </section>
  );
}

export function Images() {
  const cameras = session.value?.cameras ?? [];
  if (cameras.length === 0) return <p>No session yet: go to Set up.</p>;
  const [shownCamera, shownFrame] = place.value.parts;
  if (shownCamera && shownFrame) return <Refused camera={shownCamera} frame={shownFrame} />;
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
              const { text, bad } = wordsOfFrame(camera.name, frame);
              return (
                <button key={frame} class="card" onClick={() => go(inRun(camera.name, frame) ? "results" : "images", [camera.name, frame])}>
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
