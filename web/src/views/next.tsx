// SPDX-License-Identifier: Apache-2.0
// What to record next: suggestions in words and as outlines over an image of the camera.
import { signal } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";
import { imagePath } from "../api/client";
import type { Suggestions } from "../api/types";
import type { CameraResult } from "../base/calibration";
import { Plane } from "../image/plane";
import { Cameras, Now } from "../live/cameras";
import { Thumb, useImage } from "../parts/picture";
import { activeJob, detections, place, project, run, session, watchFolders } from "../state/project";
import { findSuggestions, lastSuggestions } from "../state/suggestions";

function Outlines({ camera, outlines }: { camera: CameraResult; outlines: [number, number][][] }) {
  const picture = useImage(imagePath(camera.name, camera.frames[0]?.frame ?? "", 0));
  return <Plane name={camera.name} picture={picture} size={camera.image_size} outlines={outlines} />;
}

/** The image that arrived last, and whether the target was found in it. */
function LastImage() {
  const last = Object.values(detections.value).at(-1);
  if (!last) return <p>Save images into the folders of the session's cameras.</p>;
  return (
    <div class="row last">
      <Thumb camera={last.camera} frame={last.frame} />
      <p class={last.points > 0 ? "" : "problem"} data-last={`${last.camera}/${last.frame}`}>
        {last.camera} / {last.frame}: {last.points > 0 ? `${last.points} points` : last.why || "no target"}
      </p>
    </div>
  );
}

/** Frames and sigma while images arrive, the newest last. */
const course = signal<{ frames: number; sigma: number | null }[]>([]);
const addToCourse = ({ frames, sigma_now }: Suggestions): void => {
  course.value = [...course.value.filter((each) => each.frames !== frames), { frames, sigma: sigma_now }];
};

function Watching() {
  const watching = project.value?.watching ?? false;
  const shown = course.value.slice(-8);
  return (
    <section>
      <div class="row">
        <button
          class="main"
          aria-pressed={watching}
          disabled={!session.value}
          onClick={() => {
            if (!watching) course.value = [];
            void watchFolders(!watching);
          }}
        >
          {watching ? "Stop watching" : "Watch the folders"}
        </button>
        <span class="quiet">
          {watching
            ? activeJob.value
              ? "calibrating with the images that have arrived"
              : "waiting for images"
            : "images that arrive are looked at, and calibration goes on with them"}
        </span>
      </div>
      {watching && <LastImage />}
      <Now />
      {watching && shown.length > 0 && (
        <p aria-live="polite">
          sigma of the projection with {shown.map(({ frames, sigma }) => `${frames} frames: ${sigma === null ? "not determined" : `${sigma.toPrecision(2)} px`}`).join("; ")}
        </p>
      )}
    </section>
  );
}

function Suggested() {
  const next = lastSuggestions.value;
  const [busy, setBusy] = useState(false);
  const number = place.value.run;
  useEffect(() => {
    if (number === null || run.value?.run !== number) return;
    setBusy(true);
    void findSuggestions().then((suggested) => {
      if (suggested && project.value?.watching) addToCourse(suggested);
      setBusy(false);
    });
  }, [run.value]);
  if (number === null) return <p>No result yet.</p>;
  if (!next) return <p aria-busy={busy}>{busy ? "Weighing views…" : "There are no suggestions for this run."}</p>;
  return (
    <>
      <p data-frames={next.frames}>
        {next.frames} frames;{" "}
        {next.sigma_now === null ? "they do not determine all parameters yet" : `sigma of the projection ${next.sigma_now.toPrecision(2)} px, goal ${next.goal} px`}
        {next.reached ? ": reached" : ""}
        {next.bound ? `; ${next.bound.words}` : ""}
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

/** The session's cameras that this machine has, with the first suggestion over the live image. */
function Recording() {
  const places = (session.value?.cameras ?? []).filter((camera) => !camera.plenoptic).map(({ name, folder }) => ({ camera: name, folder }));
  const sizes = Object.fromEntries((run.value?.cameras ?? []).map((camera) => [camera.name, camera.image_size]));
  if (places.length === 0) return null;
  return <Cameras places={places} outlines={lastSuggestions.value?.views[0]?.outline ?? {}} sizes={sizes} />;
}

export function Next() {
  return (
    <>
      <Recording />
      <Watching />
      <Suggested />
    </>
  );
}
