// SPDX-License-Identifier: Apache-2.0
// Totally focused image and virtual depth of a raw plenoptic image; the pointer in one view marks the place in all.
import { useEffect, useMemo, useState } from "preact/hooks";
import { ask } from "../api/client";
import type { Focus, Lenses } from "../api/types";
import type { Pixel } from "../image/choose";
import type { VirtualPoint } from "../image/lenses";
import { fromFocused, inFocused, virtualPointAt, virtualPointOf } from "../image/lenses";
import { Plane } from "../image/plane";
import { useImage } from "../parts/picture";
import { viridis } from "../plot/viridis";
import { activeJob, attempt, lastJob } from "../state/project";
import type { Chosen } from "./frame";

interface Linked extends Chosen {
  lenses: Lenses;
  /** Where the pointer is in the raw image. */
  raw: Pixel | null;
  virtual: VirtualPoint | null;
  onVirtual: (point: VirtualPoint | null) => void;
}

/** Depths as a picture, between the 2nd and the 98th percentile. */
function pictureOf(focus: Focus): { picture: HTMLCanvasElement; nearest: number; farthest: number } {
  const known = focus.depth.filter((depth): depth is number => depth !== null).sort((a, b) => a - b);
  const nearest = known[Math.floor(0.02 * known.length)] ?? 0;
  const farthest = known[Math.floor(0.98 * known.length)] ?? 1;
  const picture = document.createElement("canvas");
  picture.width = focus.columns;
  picture.height = focus.rows;
  const canvas = picture.getContext("2d");
  const pixels = canvas?.createImageData(focus.columns, focus.rows);
  if (canvas && pixels) {
    focus.depth.forEach((depth, i) => {
      if (depth !== null) pixels.data.set([...viridis((depth - nearest) / (farthest - nearest || 1)), 255], 4 * i);
    });
    canvas.putImageData(pixels, 0, 0);
  }
  return { picture, nearest, farthest };
}

function Panes({ focus, path, linked }: { focus: Focus; path: string; linked: Linked }) {
  const depth = useMemo(() => pictureOf(focus), [focus]);
  const image = useImage(`${path}/focused`);
  const marks = linked.virtual ? [inFocused(focus, linked.virtual.at)] : [];
  const onPointer = (at: Pixel | null): void => linked.onVirtual(at && virtualPointAt(focus, fromFocused(focus, at)));
  useEffect(() => {
    if (linked.raw) linked.onVirtual(virtualPointOf(focus, linked.lenses, linked.raw));
  }, [linked.raw]);
  return (
    <div class="columns">
      <figure class="pane">
        <Plane name="totally focused image" picture={image} size={focus.size} marks={marks} onPointer={onPointer} />
        <figcaption>totally focused image</figcaption>
      </figure>
      <figure class="pane">
        <Plane name="virtual depth" picture={depth.picture} size={focus.size} marks={marks} onPointer={onPointer} />
        <figcaption data-depth={linked.virtual?.depth ?? ""}>
          virtual depth {depth.nearest.toFixed(2)} to {depth.farthest.toFixed(2)}
          {linked.virtual ? `; here ${linked.virtual.depth.toFixed(2)}` : ""}
        </figcaption>
      </figure>
    </div>
  );
}

export function VirtualImage(linked: Linked) {
  const [focus, setFocus] = useState<Focus | null>(null);
  const path = `/api/runs/${linked.number}/focus/${encodeURIComponent(linked.camera.name)}/${encodeURIComponent(linked.frame)}`;
  const job = lastJob.value;
  const finished = job?.kind === "focus" && job.state === "done" ? job.id : 0;
  useEffect(() => {
    setFocus(null);
    linked.onVirtual(null);
    void attempt(async () => setFocus(await ask<Focus | null>("GET", path)));
  }, [path, finished]);
  if (focus) return <Panes focus={focus} path={path} linked={linked} />;
  return (
    <p>
      <button
        disabled={activeJob.value !== null}
        onClick={() =>
          attempt(async () => {
            await ask("POST", "/api/jobs", { kind: "focus", run: linked.number, camera: linked.camera.name, frame: linked.frame });
          })
        }
      >
        Virtual depth and focused image
      </button>
    </p>
  );
}
