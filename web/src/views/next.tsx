// SPDX-License-Identifier: Apache-2.0
// What to record next: suggestions in words and as outlines over an image of the camera.
import { useEffect, useState } from "preact/hooks";
import { ask, imagePath } from "../api/client";
import type { CameraResult, Suggestions } from "../api/types";
import { Plane } from "../image/plane";
import { useImage } from "../parts/picture";
import { attempt, place, run } from "../state/project";

function Outlines({ camera, outlines }: { camera: CameraResult; outlines: [number, number][][] }) {
  const picture = useImage(imagePath(camera.name, camera.frames[0]?.frame ?? "", 0));
  return <Plane name={camera.name} picture={picture} size={camera.image_size} outlines={outlines} />;
}

export function Next() {
  const [next, setNext] = useState<Suggestions | null>(null);
  const [busy, setBusy] = useState(false);
  const number = place.value.run;
  useEffect(() => {
    if (number === null) return;
    setBusy(true);
    setNext(null);
    void attempt(async () => setNext(await ask("POST", "/api/suggest", { run: number, count: 5 }))).then(() => setBusy(false));
  }, [number]);
  if (number === null) return <p>No result yet: calibrate in Set up.</p>;
  if (!next) return <p aria-busy={busy}>{busy ? "Weighing views…" : "There are no suggestions for this run."}</p>;
  return (
    <>
      <p>
        {next.frames} frames;{" "}
        {next.sigma_now === null ? "they do not determine all parameters yet" : `sigma of the projection ${next.sigma_now.toPrecision(2)} px, goal ${next.goal} px`}
        {next.reached ? ": reached" : ""}
        {next.exhausted ? "; more views of this target at these distances add little" : ""}
      </p>
      <ol class="suggestions">
        {next.views.map((view, i) => {
          const camera = run.value?.cameras.find((each) => each.name === view.camera);
          return (
            <li key={i}>
              <p>{view.words}</p>
              {camera && <Outlines camera={camera} outlines={view.outline[camera.name] ?? []} />}
            </li>
          );
        })}
      </ol>
    </>
  );
}
