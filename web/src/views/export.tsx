// SPDX-License-Identifier: Apache-2.0
// Files for other programs, each with the command line that makes it.
import { useState } from "preact/hooks";
import { ask, blob } from "../api/client";
import { attempt, place, project, run } from "../state/project";

function save(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}

export function Export() {
  const [format, setFormat] = useState("opencv");
  const [camera, setCamera] = useState("");
  const [made, setMade] = useState<{ command: string; files: { name: string; text: string }[] } | null>(null);
  const now = run.value;
  const number = place.value.run;
  if (!now || number === null) return <p>No result yet: calibrate in Set up.</p>;
  const names = now.cameras.map((each) => each.name);
  const make = () =>
    attempt(async () => {
      setMade(null);
      const query = new URLSearchParams({ format, ...(camera ? { camera } : {}) });
      setMade(await ask("GET", `/api/runs/${number}/export?${query}`));
    });
  return (
    <>
      <div class="row">
        <label>
          format{" "}
          <select value={format} onChange={(event) => setFormat(event.currentTarget.value)}>
            {(project.value?.formats ?? []).map((name) => (
              <option key={name}>{name}</option>
            ))}
          </select>
        </label>
        <label>
          camera{" "}
          <select value={camera} onChange={(event) => setCamera(event.currentTarget.value)}>
            <option value="">all</option>
            {names.map((name) => (
              <option key={name}>{name}</option>
            ))}
          </select>
        </label>
        <button class="main" onClick={make}>
          Export
        </button>
        <button onClick={() => attempt(async () => save(await blob(`/api/runs/${number}/report.html`), "report.html"))}>Report (HTML)</button>
      </div>
      {made && (
        <section>
          <p>
            The same on the command line: <code>{made.command}</code>
          </p>
          {made.files.map(({ name, text }) => (
            <div key={name}>
              <button onClick={() => save(new Blob([text]), name)}>Save {name}</button>
              <pre tabIndex={0}>{text}</pre>
            </div>
          ))}
        </section>
      )}
      <p class="quiet">All files of this run are in {now.folder}.</p>
    </>
  );
}
