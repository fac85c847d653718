// SPDX-License-Identifier: Apache-2.0
// Camera models by held-out images; two runs against each other, in the words of `plenocal compare` and over the image.
import { useState } from "preact/hooks";
import { ask } from "../api/client";
import type { Difference } from "../api/calibration";
import type { Comparison } from "../api/types";
import { brief } from "../base/numbers";
import { ArrowMap } from "../plot/image_field";
import { attempt, project } from "../state/project";
import { Models } from "./models";

function Differences({ maps }: { maps: Difference[] }) {
  return (
    <div class="figures">
      {maps.map(({ camera, image_size, distance, rms, predicted, differs, field }) => (
        <ArrowMap
          key={`${camera} ${distance}`}
          title={`${camera}, ${distance === null ? "far away" : `${distance} m`}: ${brief(rms)} px RMS`}
          note={`${predicted === null ? "The standard errors predict nothing." : `Standard errors predict ${brief(predicted)} px: ${differs ? "the runs differ by more" : "no more than that"}.`} From the first run to the second, without the motion of the camera that poses follow.`}
          size={image_size}
          field={field}
          values={field.rms}
        />
      ))}
    </div>
  );
}

function Runs() {
  const runs = project.value?.runs ?? [];
  const last = runs[runs.length - 1]?.run ?? 0;
  const [a, setA] = useState(runs[runs.length - 2]?.run ?? last);
  const [b, setB] = useState(last);
  const [found, setFound] = useState<Comparison | null>(null);
  if (runs.length < 2) return <p>There are fewer than two runs.</p>;
  const choice = (label: string, value: number, set: (value: number) => void) => (
    <label>
      {label}{" "}
      <select value={value} onChange={(event) => set(Number(event.currentTarget.value))}>
        {runs.map((each) => (
          <option key={each.run} value={each.run}>
            run {each.run} ({each.grade ?? "?"})
          </option>
        ))}
      </select>
    </label>
  );
  return (
    <section>
      <h2>Two runs</h2>
      <div class="row">
        {choice("from", a, setA)}
        {choice("to", b, setB)}
        <button class="main" onClick={() => attempt(async () => setFound(await ask<Comparison>("GET", `/api/compare?a=${a}&b=${b}`)))}>
          Compare
        </button>
      </div>
      {found && <pre tabIndex={0}>{found.text}</pre>}
      {found && <Differences key={found.command} maps={found.maps} />}
    </section>
  );
}

export function Compare() {
  return (
    <>
      <Models />
      <Runs />
    </>
  );
}
