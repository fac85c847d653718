// SPDX-License-Identifier: Apache-2.0
// The shown image without distortion, or rectified beside another camera's, with lines to compare with.
import { useEffect, useState } from "preact/hooks";
import { blob } from "../api/client";
import { attempt, run } from "../state/project";

export function Straight({ number, camera, frame }: { number: number; camera: string; frame: string }) {
  // "" shows none, the camera's own name its undistorted image.
  const [kind, setKind] = useState("");
  const [made, setMade] = useState({ path: "", url: "" });
  const others = (run.value?.cameras ?? [])
    .filter(({ name, plenoptic, frames }) => name !== camera && !plenoptic && frames.some((each) => each.frame === frame))
    .map(({ name }) => name);
  const query = new URLSearchParams({ camera, frame, ...(kind === camera ? {} : { with: kind }) });
  const path = kind === "" ? null : `/api/runs/${number}/straight?${query}`;
  useEffect(() => {
    if (path) void attempt(async () => setMade({ path, url: URL.createObjectURL(await blob(path)) }));
  }, [path]);
  useEffect(() => () => URL.revokeObjectURL(made.url), [made]);
  return (
    <div class="straight">
      <label>
        preview
        <select value={kind} onChange={(event) => setKind(event.currentTarget.value)}>
          <option value="">none</option>
          <option value={camera}>undistorted</option>
          {others.map((other) => (
            <option key={other} value={other}>
              rectified with {other}
            </option>
          ))}
        </select>
      </label>
      {made.path === path && (
        <figure class={kind === camera ? "lined crossed" : "lined"}>
          <img src={made.url} alt={kind === camera ? `${camera} ${frame} without distortion` : `${camera} and ${kind} ${frame}, rectified`} />
          <figcaption>
            {kind === camera
              ? "Edges that are straight in space run along straight lines here."
              : "A point of space lies in one row of both images."}
          </figcaption>
        </figure>
      )}
    </div>
  );
}
