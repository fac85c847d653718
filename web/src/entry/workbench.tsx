// SPDX-License-Identifier: Apache-2.0
import "./workbench.css";
import { render } from "preact";
import type { ComponentType } from "preact";
import { ask, takeToken } from "../api/client";
import { followColours } from "../plot/drawings";
import { activeJob, addJob, attempt, away, go, lastJob, message, place, project, redo, run, start, undo } from "../state/project";
import { Compare } from "../views/compare";
import { Export } from "../views/export";
import { Images } from "../views/images";
import { excludeChosen, Results, step } from "../views/results";
import { Next } from "../views/next";
import { SetUp } from "../views/setup";
import { InSpace } from "../views/space";

const kViews: [string, string, ComponentType][] = [
  ["setup", "Set up", SetUp],
  ["images", "Images", Images],
  ["results", "Results", Results],
  ["space", "Space", InSpace],
  ["next", "Next views", Next],
  ["compare", "Compare", Compare],
  ["export", "Export", Export],
];

function Rail() {
  return (
    <nav aria-label="screens">
      {kViews.map(([name, title], i) => (
        <button key={name} aria-current={place.value.view === name ? "page" : undefined} title={`${title} (${i + 1})`} onClick={() => go(name)}>
          {title}
        </button>
      ))}
    </nav>
  );
}

function JobStrip() {
  const job = lastJob.value;
  if (!job) return <footer>no job yet</footer>;
  const part = job.total ? `${job.done ?? 0} of ${job.total}` : "";
  return (
    <footer>
      <span aria-live="polite" data-job={job.state}>
        {job.kind === "init" ? "propose" : job.kind} {job.state} {job.state === "running" ? (job.stage ?? "") : ""} {job.state === "running" ? part : ""}
      </span>
      {job.state === "running" && <progress max={job.total || 1} {...(job.total ? { value: job.done ?? 0 } : {})} />}
      {activeJob.value && <button onClick={() => attempt(() => ask("DELETE", `/api/jobs/${job.id}`))}>stop</button>}
      <code title="the same on the command line">{job.command}</code>
      <button onClick={() => navigator.clipboard?.writeText(job.command)}>copy</button>
    </footer>
  );
}

function Header() {
  const runs = project.value?.runs ?? [];
  const shown = place.value.run;
  return (
    <header>
      <b>plenocal</b>
      <span class="path">{project.value?.root ?? ""}</span>
      {runs.length > 0 && (
        <label>
          run{" "}
          <select value={shown ?? ""} onChange={(event) => go(place.value.view, place.value.parts, Number(event.currentTarget.value))}>
            {runs.map((each) => (
              <option key={each.run} value={each.run}>
                {each.run} {each.grade ?? ""}
              </option>
            ))}
          </select>
        </label>
      )}
    </header>
  );
}

function Page() {
  const [name, title, View] = kViews.find(([each]) => each === place.value.view) ?? kViews[0]!;
  return (
    <>
      <Header />
      <Rail />
      <main key={name} data-view={name} data-run={run.value?.run ?? ""}>
        <h1>{title}</h1>
        {away.value && (
          <p class="problem" role="alert">
            The server is away. Start 'plenocal workbench' again: nothing is lost.
          </p>
        )}
        {message.value && (
          <p class="problem" role="alert">
            {message.value}
          </p>
        )}
        <View />
      </main>
      <JobStrip />
    </>
  );
}

function onKey(event: KeyboardEvent): void {
  const element = event.target instanceof HTMLElement ? event.target : null;
  if (element && ["INPUT", "TEXTAREA", "SELECT"].includes(element.tagName)) return;
  if (event.ctrlKey || event.metaKey) {
    if (event.key.toLowerCase() !== "z") return;
    event.preventDefault();
    void (event.shiftKey ? redo() : undo());
    return;
  }
  if (event.altKey) return;
  const view = kViews[Number(event.key) - 1];
  if (view) go(view[0]);
  if (place.value.view !== "results") return;
  if (event.key === "ArrowRight") step(1);
  if (event.key === "ArrowLeft") step(-1);
  if (event.key === "x") excludeChosen();
  if (event.key === "c" && !activeJob.value) void addJob("calibrate");
}

takeToken();
followColours();
start();
addEventListener("keydown", onKey);
render(<Page />, document.getElementById("page")!);
