// SPDX-License-Identifier: Apache-2.0
// Target and camera poses of a run.
import { useEffect, useMemo, useState } from "preact/hooks";
import { ask } from "../api/client";
import type { Space } from "../api/types";
import { Scene } from "../space/scene";
import { attempt, go, place, run } from "../state/project";

export function InSpace() {
  const [space, setSpace] = useState<Space | null>(null);
  const number = place.value.run;
  const now = run.value;
  useEffect(() => {
    if (number === null) return;
    void attempt(async () => setSpace(await ask("GET", `/api/runs/${number}/space`)));
  }, [number]);
  const rms = useMemo(() => {
    const known = new Map(now?.cameras.flatMap((camera) => camera.frames.map((each) => [`${camera.name}/${each.frame}`, each.rms])));
    return (camera: string, frame: string): number | null => known.get(`${camera}/${frame}`) ?? null;
  }, [now]);
  if (number === null) return <p>No result yet: calibrate in Set up.</p>;
  if (!space) return <p>…</p>;
  return <Scene {...space} rms={rms} byRms wheel onOpen={(camera, frame) => go("look", [camera, frame], number)} />;
}
