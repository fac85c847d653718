// SPDX-License-Identifier: Apache-2.0
// One image of the result: its points and residuals, what is left out of it, and a plenoptic camera's other views.
import { signal } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";
import { ask, imagePath } from "../api/client";
import type { Lenses, Point } from "../api/types";
import type { CameraResult } from "../base/calibration";
import type { VirtualPoint } from "../image/lenses";
import { rawPixelsOf } from "../image/lenses";
import { MicroImages } from "../image/micro_images";
import { Plane } from "../image/plane";
import { useImage } from "../parts/picture";
import { wordsOfFrame } from "../state/frame_words";
import { attempt, exclude, include, pointRulesOf, ruleOf, session } from "../state/project";
import { Straight } from "./straight";
import { VirtualImage } from "./virtual_image";

/** An image of a run, and a marker in it. */
export interface Chosen {
  number: number;
  camera: CameraResult;
  frame: string;
  marker: number | null;
}

// Of the shown image; the keyboard excludes them, too.
const markers = signal<number[]>([]);

/** Excludes the chosen points; where there are none, the image, or includes it again. */
export function excludeShown({ camera, frame }: Chosen): Promise<void> {
  if (markers.value.length > 0) {
    const rule = { camera: camera.name, frame, markers: [...markers.value].sort((a, b) => a - b) };
    markers.value = [];
    return exclude(rule);
  }
  const rule = ruleOf(camera.name, frame);
  return rule ? include(rule) : exclude({ camera: camera.name, frame });
}

const counted = (count: number, word: string): string => `${count} ${word}${count === 1 ? "" : "s"}`;

function ChosenPoints({ points, noise }: { points: Point[]; noise: number | null }) {
  const [marker, x, y, dx, dy, used] = points[0] ?? [0, 0, 0, null, null, 0];
  if (markers.value.length !== 1 || points.length === 0) return <span>{counted(markers.value.length, "point")} chosen</span>;
  if (points.length > 1) {
    return (
      <span>
        point {marker}: in {counted(points.length, "micro image")}, {points.filter((each) => each[5]).length} used
      </span>
    );
  }
  const length = dx === null || dy === null ? null : Math.hypot(dx, dy);
  return (
    <span>
      point {marker} at ({x.toFixed(2)}, {y.toFixed(2)}):{" "}
      {length === null ? "no residual" : `residual ${length.toFixed(3)} px${noise ? `, ${(length / noise).toFixed(1)} times the noise` : ""}`}
      {used ? "" : ", rejected"}
    </span>
  );
}

export function useRunPart<T>(path: string | null): T | null {
  const [part, setPart] = useState<T | null>(null);
  useEffect(() => {
    setPart(null);
    if (path) void attempt(async () => setPart(await ask<T>("GET", path)));
  }, [path]);
  return part;
}

export function Frame(chosen: Chosen) {
  const { number, camera, frame, marker } = chosen;
  const [factor, setFactor] = useState(50);
  const [virtual, setVirtual] = useState<VirtualPoint | null>(null);
  const [raw, setRaw] = useState<[number, number] | null>(null);
  const named = `camera=${encodeURIComponent(camera.name)}`;
  const points = useRunPart<{ points: Point[] }>(`/api/runs/${number}/points?${named}&frame=${encodeURIComponent(frame)}`)?.points ?? [];
  const lenses = useRunPart<Lenses>(camera.plenoptic ? `/api/runs/${number}/lenses?${named}` : null);
  const picture = useImage(imagePath(camera.name, frame, 0));
  useEffect(() => {
    markers.value = marker === null ? [] : [marker];
  }, [number, camera.name, frame, marker]);
  const onPointer = (at: [number, number] | null): void => {
    setRaw(at);
    if (!at) setVirtual(null);
  };
  const rule = ruleOf(camera.name, frame);
  const pointRules = pointRulesOf(camera.name, frame);
  const result = camera.frames.find((each) => each.frame === frame);
  const ofChosen = points.filter(([marker]) => markers.value.includes(marker));
  return (
    <section>
      <h2>
        {camera.name} / {frame}
      </h2>
      <p>
        {result ? `${result.points} points used, ${result.rejected} rejected, RMS ${result.rms?.toFixed(3) ?? "-"} px` : wordsOfFrame(camera.name, frame).text}
      </p>
      <Plane
        name={`${camera.name} ${frame}`}
        picture={picture}
        size={camera.image_size}
        points={points}
        factor={factor}
        excluded={rule !== undefined}
        excludedMarkers={pointRules.flatMap((each) => each.markers)}
        lenses={lenses}
        marks={virtual && lenses ? rawPixelsOf(lenses, virtual) : []}
        chosen={markers.value}
        onChoose={(chosenNow) => (markers.value = chosenNow)}
        {...(lenses ? { onPointer } : {})}
      />
      <div class="row">
        <button disabled={!session.value} onClick={() => excludeShown(chosen)}>
          {markers.value.length > 0 ? `Exclude ${counted(markers.value.length, "point")} (x)` : rule ? "Include again" : "Exclude (x)"}
        </button>
        {markers.value.length > 0 && (
          <>
            <ChosenPoints points={ofChosen} noise={camera.noise} />
            <button onClick={() => (markers.value = [])}>none</button>
          </>
        )}
        <label>
          residuals ×
          <select value={factor} onChange={(event) => setFactor(Number(event.currentTarget.value))}>
            {[1, 10, 50, 200, 1000].map((value) => (
              <option key={value} value={value}>
                {value}
              </option>
            ))}
          </select>
        </label>
      </div>
      {pointRules.map((each) => (
        <p key={each.markers.join()} class="row">
          <span>
            excluded: {each.markers.length > 1 ? "points" : "point"} {each.markers.join(", ")}
          </span>
          <button onClick={() => include(each)}>Include again</button>
        </p>
      ))}
      {lenses && picture && markers.value.length === 1 && (
        <MicroImages picture={picture} lenses={lenses} points={ofChosen} factor={factor} />
      )}
      {!camera.plenoptic && <Straight number={number} camera={camera.name} frame={frame} />}
      {lenses && <VirtualImage {...chosen} lenses={lenses} raw={raw} virtual={virtual} onVirtual={setVirtual} />}
    </section>
  );
}
