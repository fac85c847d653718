// SPDX-License-Identifier: Apache-2.0
// Target and camera poses of a run, with the views that would come next.
import { useEffect, useMemo, useState } from "preact/hooks";
import { ask } from "../api/client";
import type { Accuracy, Space } from "../api/calibration";
import { targetOf } from "../base/calibration";
import { inverseOf } from "../space/geometry";
import type { Ghost } from "../space/geometry";
import { ExtrinsicsTable } from "../parts/table";
import { AccuracyCharts } from "../report/accuracy";
import { Scene } from "../space/scene";
import { attempt, go, place, run } from "../state/project";
import { findSuggestions, suggestionsOfRun } from "../state/suggestions";

export function InSpace() {
  const [space, setSpace] = useState<Space | null>(null);
  const [accuracy, setAccuracy] = useState<Accuracy[]>([]);
  const [withNext, setWithNext] = useState(false);
  const number = place.value.run;
  const now = run.value;
  const suggestions = withNext ? suggestionsOfRun() : null;
  useEffect(() => {
    if (number === null) return;
    void attempt(async () => setSpace(await ask("GET", `/api/runs/${number}/space`)));
    void attempt(async () => setAccuracy(await ask("GET", `/api/runs/${number}/accuracy`)));
  }, [number, now]);
  useEffect(() => {
    if (withNext) void findSuggestions().then((found) => found ?? setWithNext(false));
  }, [withNext, now]);
  const ghosts = useMemo(
    () => suggestions?.views.map((view, i): Ghost => ({ name: `next ${i + 1}`, T_target_camera: inverseOf(view.T_camera_target) })) ?? [],
    [suggestions],
  );
  const rms = useMemo(() => {
    const known = new Map(now?.cameras.flatMap((camera) => camera.frames.map((each) => [`${camera.name}/${each.frame}`, each.rms])));
    return (camera: string, frame: string): number | null => known.get(`${camera}/${frame}`) ?? null;
  }, [now]);
  const shown = useMemo(() => space && targetOf(space), [space]);
  if (number === null) return <p>No result yet: calibrate in Set up.</p>;
  if (!shown || !now) return <p>…</p>;
  return (
    <>
      <Scene {...shown} cameras={now.cameras} rms={rms} byRms wheel ghosts={ghosts} onOpen={(camera, frame) => go("results", [camera, frame], number)} />
      <div class="row">
        <button aria-pressed={withNext} onClick={() => setWithNext(!withNext)}>
          suggested poses
        </button>
        <span class="quiet" aria-live="polite" data-ghosts={ghosts.length}>
          {withNext ? (suggestions?.views[0]?.words ?? "weighing views…") : "what to record next, as dashed cameras"}
        </span>
      </div>
      <ExtrinsicsTable cameras={now.cameras} />
      <AccuracyCharts accuracy={accuracy} />
    </>
  );
}
