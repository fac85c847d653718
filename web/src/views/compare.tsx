// SPDX-License-Identifier: Apache-2.0
// Camera models by held-out images; two runs against each other, in the words of `plenocal compare`.
import { useState } from "preact/hooks";
import { ask } from "../api/client";
import { attempt, project } from "../state/project";
import { Models } from "./models";

function Runs() {
  const runs = project.value?.runs ?? [];
  const last = runs[runs.length - 1]?.run ?? 0;
  const [a, setA] = useState(runs[runs.length - 2]?.run ?? last);
  const [b, setB] = useState(last);
  const [text, setText] = useState("");
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
        <button
          class="main"
          onClick={() => attempt(async () => setText((await ask<{ text: string }>("GET", `/api/compare?a=${a}&b=${b}`)).text))}
        >
          Compare
        </button>
      </div>
      {text && <pre tabIndex={0}>{text}</pre>}
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
