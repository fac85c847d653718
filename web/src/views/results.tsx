// SPDX-License-Identifier: Apache-2.0
// Result: verdict, bars of the frames, the chosen image with its residuals, parameters, sigma maps.
import { signal } from "@preact/signals";
import { useEffect, useMemo, useState } from "preact/hooks";
import { ask } from "../api/client";
import type { Residuals, SigmaMap } from "../api/calibration";
import type { Influence, Preview } from "../api/types";
import { rowsOf } from "../base/calibration";
import type { CameraResult, RunResult } from "../base/calibration";
import { brief } from "../base/numbers";
import { CamerasTable, ExtrinsicsTable } from "../parts/table";
import { VerdictBox } from "../parts/verdict";
import { FrameBars } from "../plot/frame_bars";
import { ArrowMap } from "../plot/image_field";
import { SigmaPicture } from "../plot/sigma_map";
import { activeJob, addJob, attempt, go, message, place, project, run, session } from "../state/project";
import { barsOf } from "./bars";
import type { Order, Ordered } from "./bars";
import { excludeShown, Frame, useRunPart } from "./frame";
import type { Chosen } from "./frame";

/** The run before the shown one, when both have the same cameras: what a change of the session did. */
function Change({ now }: { now: RunResult }) {
  const runs = project.value?.runs ?? [];
  const place = runs.findIndex((each) => each.run === now.run);
  const [before, after] = [runs[place - 1], runs[place]];
  if (!before?.rms || !after?.rms) return null;
  const [was, is] = [before.projection, after.projection];
  const worse = `${before.models}` === `${after.models}` && was !== undefined && (is ?? Infinity) > 1.05 * was;
  const text = (error?: number) => (error === undefined ? "not determined" : `${brief(error, 2)} px`);
  return (
    <p class={worse ? "problem" : "quiet"} data-change={worse ? "worse" : "same"}>
      Against run {before.run}: RMS {before.rms[0]?.toFixed(3)} → {after.rms[0]?.toFixed(3)} px, error of the projection {text(was)} → {text(is)}
      {worse ? ": worse" : ""}
    </p>
  );
}

/** What the run would be without all that the session leaves out by now, before it is made again. */
function Before({ now }: { now: RunResult }) {
  const [preview, setPreview] = useState<Preview | null>(null);
  const rules = JSON.stringify(session.value?.exclude ?? []);
  useEffect(() => {
    if (rules === "[]") return setPreview(null);
    let wanted = true;
    void ask<Preview | null>("GET", `/api/runs/${now.run}/preview`)
      .then((found) => wanted && setPreview(found))
      .catch(() => wanted && setPreview(null));
    return () => void (wanted = false);
  }, [now, rules]);
  if (!preview) return null;
  const { points, rms, sigma, sigmas, unknown } = preview;
  const worse = (sigma[1] ?? Infinity) > 1.05 * (sigma[0] ?? Infinity);
  const text = (value: number | null): string => (value === null ? "not determined" : `${brief(value, 3)} px`);
  return (
    <p class={worse ? "problem" : ""} aria-live="polite" data-preview={points}>
      Preview, without the {points} points that are excluded by now: RMS {rms[0].toFixed(3)} → {rms[1].toFixed(3)} px, sigma of the projection {text(sigma[0])} →{" "}
      {text(sigma[1])}
      {unknown && sigmas !== null ? `; ${unknown} changes most, by ${brief(sigmas, 2)} sigma` : ""}
      {worse ? ": worse" : ""}
    </p>
  );
}

function ResidualsOf({ number, camera }: { number: number; camera: CameraResult }) {
  const residuals = useRunPart<Residuals>(`/api/runs/${number}/residuals?camera=${encodeURIComponent(camera.name)}`);
  const markers = useMemo(() => (residuals ? rowsOf(residuals.markers).filter(({ points }) => points > 0) : []), [residuals]);
  const bars = useMemo(
    () =>
      markers.map(({ marker, points, rejected, rms }) => ({
        name: String(marker),
        size: rms,
        words: `${rms?.toFixed(3)} px, ${points} points, ${rejected} rejected`,
      })),
    [markers],
  );
  if (!residuals) return null;
  const worstOf = (name: string): string => markers.find(({ marker }) => String(marker) === name)?.worst ?? "";
  return (
    <>
      <h2>{camera.name}: RMS of the markers</h2>
      <FrameBars
        name={`${camera.name}: RMS of the markers`}
        bars={bars}
        x="marker; a click: the image with its largest residual"
        y="RMS, px"
        aspect={3}
        onChoose={(name) => go("results", [camera.name, worstOf(name), name], number)}
      />
      <ArrowMap
        key={`${number} ${camera.name}`}
        title="Residuals over the image"
        note="Mean in each cell. A pattern is an error of the camera model."
        size={camera.image_size}
        field={residuals.field}
        values={residuals.field.rms}
      />
    </>
  );
}

function Maps({ number, camera: { name, image_size } }: { number: number; camera: CameraResult }) {
  const [maps, setMaps] = useState<SigmaMap[]>([]);
  useEffect(() => {
    void attempt(async () => setMaps(await ask("GET", `/api/runs/${number}/maps?camera=${encodeURIComponent(name)}`)));
  }, [number, name]);
  return (
    <div class="figures small">
      {maps.map((map) => (
        <SigmaPicture key={`${number} ${name} ${map.distance}`} map={map} size={image_size} />
      ))}
    </div>
  );
}

/** Camera and frame of the address, or the worst frame of the first camera. */
function chosenOf(now: RunResult): Chosen | null {
  const [name, frame, marker] = place.value.parts;
  const camera = now.cameras.find((each) => each.name === name) ?? now.cameras[0];
  if (!camera) return null;
  const worst = [...camera.frames].sort((a, b) => (b.rms ?? 0) - (a.rms ?? 0))[0];
  return { number: now.run, camera, frame: frame ?? worst?.frame ?? "", marker: marker === undefined ? null : Number(marker) };
}

/** Frames to step through, in the order of the bars; null: all of the camera that is shown. */
const part = signal<{ camera: string; order: Order; frames: string[] } | null>(null);
const partOf = (camera: string): string[] | undefined => (part.value?.camera === camera ? part.value.frames : undefined);

export function step(by: number): void {
  const now = run.value;
  const chosen = now && chosenOf(now);
  if (!chosen) return;
  const frames = partOf(chosen.camera.name) ?? chosen.camera.frames.map((each) => each.frame);
  const next = frames[frames.indexOf(chosen.frame) + by];
  if (next) go("results", [chosen.camera.name, next], chosen.number);
}

export function excludeChosen(): void {
  const chosen = run.value && chosenOf(run.value);
  if (chosen && session.value) void excludeShown(chosen);
}

/** Which of the frames to step through is shown. */
function Stepper({ camera, frame }: Chosen) {
  const frames = partOf(camera.name);
  const all = frames ?? camera.frames.map((each) => each.frame);
  const index = all.indexOf(frame);
  return (
    <div class="row" data-step={`${index + 1} of ${all.length}`}>
      <button disabled={index <= 0} title="frame before (left)" onClick={() => step(-1)}>
        ←
      </button>
      <button disabled={index < 0 || index >= all.length - 1} title="frame after (right)" onClick={() => step(1)}>
        →
      </button>
      <span aria-live="polite">
        {index + 1} of {frames ? `${all.length} chosen frames` : `${all.length} frames`}
      </span>
      {frames && <button onClick={() => (part.value = null)}>all frames</button>}
    </div>
  );
}

interface OfCamera extends Ordered {
  chosen: string;
  number: number;
}

function BarsOf({ camera, order, influences, chosen, number }: OfCamera) {
  const rules = session.value?.exclude;
  const bars = useMemo(() => barsOf({ camera, order, influences }), [camera, order, influences, rules]);
  const title = order === "influence" ? "influence of the frames on the result" : "RMS of the frames";
  return (
    <section>
      <h2>
        {camera.name}: {title}
      </h2>
      <FrameBars
        name={`${camera.name}: ${title}`}
        bars={bars}
        x="frame; drag: choose several, double click: all"
        y={order === "influence" ? "sigmas" : "RMS, px"}
        aspect={3}
        chosen={chosen}
        onChoose={(frame) => go("results", [camera.name, frame], number)}
        part={part.value?.order === order ? partOf(camera.name) : undefined}
        onPart={(frames) => {
          part.value = frames ? { camera: camera.name, order, frames } : null;
          if (frames?.[0] && !frames.includes(chosen)) go("results", [camera.name, frames[0]], number);
        }}
      />
    </section>
  );
}

export function Results() {
  const [order, setOrder] = useState<Order>("name");
  const [influences, setInfluences] = useState<Influence[]>([]);
  const now = run.value;
  useEffect(() => {
    setInfluences([]);
    if (!now || order !== "influence") return;
    void attempt(async () => {
      const { frames, why } = await ask<{ frames: Influence[]; why: string | null }>("GET", `/api/runs/${now.run}/influence`);
      setInfluences(frames);
      if (why) message.value = why;
    });
  }, [now, order]);
  if (!now) return <p>No result yet: calibrate in Set up.</p>;
  const chosen = chosenOf(now);
  if (!chosen) return <p>This run has no camera.</p>;
  return (
    <>
      <VerdictBox verdict={now.verdict} headline={now.headline} most={3} />
      <Change now={now} />
      <Before now={now} />
      <div class="row">
        <button class="main" disabled={activeJob.value !== null || !session.value} onClick={() => addJob("calibrate")}>
          Calibrate again (c)
        </button>
        <button onClick={() => go("next", [], now.run)}>What to record next</button>
        <label>
          order
          <select value={order} onChange={(event) => setOrder(event.currentTarget.value as Order)}>
            <option value="name">by name</option>
            <option value="rms">by RMS</option>
            <option value="influence">by influence</option>
          </select>
        </label>
      </div>
      <div class={chosen.camera.plenoptic ? "columns" : "columns beside"}>
        <div>
          {now.cameras.map((camera) => (
            <BarsOf
              key={camera.name}
              camera={camera}
              order={order}
              influences={influences}
              chosen={camera.name === chosen.camera.name ? chosen.frame : ""}
              number={now.run}
            />
          ))}
          <ExtrinsicsTable cameras={now.cameras} />
          <CamerasTable cameras={now.cameras} />
          <h2>Sigma of the projection</h2>
          <Maps number={now.run} camera={chosen.camera} />
          <ResidualsOf number={now.run} camera={chosen.camera} />
        </div>
        <div>
          <Stepper {...chosen} />
          <Frame {...chosen} />
        </div>
      </div>
    </>
  );
}
