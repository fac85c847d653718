// SPDX-License-Identifier: Apache-2.0
// What the page shows, in signals; all of it comes from the server, the place in it from the address.
import { computed, signal } from "@preact/signals";
import { ask, listen, Refused } from "../api/client";
import type { Run } from "../api/calibration";
import type { Detection, Job, Renewed, Rule, Session, State } from "../api/types";
import { resultOf } from "../base/calibration";
import type { RunResult } from "../base/calibration";

export const project = signal<State | null>(null);
export const session = signal<Session | null>(null);
export const run = signal<RunResult | null>(null);
/** The shown run with pictures that it does not have yet; null: there are none. */
export const renewed = signal<Renewed | null>(null);
export const detections = signal<Record<string, Detection>>({});
export const away = signal(false);
export const message = signal("");
export const address = signal(location.hash || "#/setup");

/** "#/results/left/0012?run=3" -> view, parts, run. */
export const place = computed(() => {
  const [path = "", query = ""] = address.value.replace(/^#\//, "").split("?");
  const parts = path.split("/").map(decodeURIComponent);
  const number = Number(new URLSearchParams(query).get("run") ?? NaN);
  const runs = project.value?.runs ?? [];
  const last = runs[runs.length - 1]?.run ?? null;
  return { view: parts[0]?.replace(/^look$/, "results") || "setup", parts: parts.slice(1), run: Number.isNaN(number) ? last : number };
});

export function go(view: string, parts: string[] = [], number: number | null = null): void {
  const query = number === null ? "" : `?run=${number}`;
  location.hash = `#/${[view, ...parts.map(encodeURIComponent)].join("/")}${query}`;
  address.value = location.hash; // now: keys may follow each other faster than events
}

export const activeJob = computed<Job | null>(() => {
  const jobs = project.value?.jobs ?? [];
  return jobs.find((job) => job.state === "running") ?? jobs.find((job) => job.state === "waiting") ?? null;
});
export const lastJob = computed<Job | null>(() => {
  const jobs = project.value?.jobs ?? [];
  return activeJob.value ?? jobs[jobs.length - 1] ?? null;
});

export function report(error: unknown): void {
  const remedy = error instanceof Refused && error.remedy ? `; ${error.remedy}` : "";
  message.value = error instanceof Error ? error.message + remedy : String(error);
}

/** Runs `work`; what goes wrong is shown. */
export async function attempt(work: () => Promise<void>): Promise<void> {
  message.value = "";
  try {
    await work();
  } catch (error) {
    report(error);
  }
}

export async function loadSession(): Promise<void> {
  session.value = project.value?.session ? await ask<Session>("GET", "/api/session") : null;
}

let loaded = "";
export async function loadRun(): Promise<void> {
  const number = place.value.run;
  if (number === null) {
    run.value = null;
    return;
  }
  const key = `${number}`;
  if (loaded === key && run.value?.run === number) return;
  loaded = key;
  run.value = resultOf(await ask<Run>("GET", `/api/runs/${number}`));
}

let turn: Promise<void> = Promise.resolve();
/** Requests that answer with the session: one after the other, so that no older answer comes last. */
function inTurn(work: () => Promise<void>): Promise<void> {
  turn = turn.catch(() => {}).then(work);
  return turn;
}

export const loadState = (): Promise<void> =>
  inTurn(async () => {
    project.value = await ask<State>("GET", "/api/state");
    await loadSession();
    await loadRun();
  });

function onJob(job: Job): void {
  const state = project.value;
  if (!state) return;
  const jobs = state.jobs.filter((each) => each.id !== job.id);
  project.value = { ...state, jobs: [...jobs, job].sort((a, b) => a.id - b.id) };
  if (job.state === "done" || job.state === "failed" || job.state === "stopped") {
    if (job.run === run.value?.run) loaded = "";
    void attempt(async () => {
      await loadState();
      if (job.state !== "done" || job.run === undefined) return;
      // While images arrive, the screen stays.
      const { view, parts } = place.value;
      if (state.watching) go(view, view === "results" ? parts : [], job.run);
      else go("results", view === "results" ? parts : [], job.run);
    }).then(() => {
      if (job.state === "failed") message.value = job.error ?? "the job failed";
    });
  }
}

export function start(): void {
  addEventListener("hashchange", () => {
    address.value = location.hash || "#/setup";
    void attempt(loadRun);
  });
  void attempt(loadState);
  void listen((name, data) => {
    away.value = name === "away";
    if (name === "job") onJob(data as Job);
    if (name === "detection") {
      const found = data as Detection;
      detections.value = { ...detections.value, [`${found.camera}/${found.frame}`]: found };
    }
    if (name === "renewed") renewed.value = data as Renewed;
    if (name === "refused") message.value = "this page's token is old: open the address that 'plenocal workbench' printed";
    if (name === "reset" || name === "session" || name === "open") void attempt(loadState);
  });
}

export const watchFolders = (on: boolean): Promise<void> =>
  attempt(async () => {
    project.value = await ask<State>("POST", "/api/watch", { on });
  });

export const addJob = (kind: string): Promise<void> =>
  attempt(async () => {
    if (kind === "detect" || kind === "calibrate") detections.value = {};
    await ask("POST", "/api/jobs", { kind });
  });

/** `hash`: of the text that is replaced; "": any. */
export const changeSession = (method: string, path: string, body: unknown, hash = ""): Promise<void> =>
  attempt(() =>
    inTurn(async () => {
      session.value = await ask<Session>(method, path, body, hash);
      project.value = await ask<State>("GET", "/api/state");
    }),
  );
export const exclude = (rule: Partial<Rule>): Promise<void> => changeSession("POST", "/api/session/exclude", rule);
export const include = (rule: Partial<Rule>): Promise<void> => changeSession("POST", "/api/session/include", rule);
export const undo = (): Promise<void> => changeSession("POST", "/api/session/undo", {});
export const redo = (): Promise<void> => changeSession("POST", "/api/session/redo", {});

/** The rule that leaves out a whole image, if there is one that says just this. */
export function ruleOf(camera: string, frame: string): Rule | undefined {
  return session.value?.exclude.find(
    (rule) => rule.frame === frame && rule.markers.length === 0 && (rule.camera === camera || rule.camera === ""),
  );
}

/** The rules that leave points out of an image. */
export function pointRulesOf(camera: string, frame: string): Rule[] {
  return (session.value?.exclude ?? []).filter(
    (rule) => rule.markers.length > 0 && (rule.frame === frame || rule.frame === "") && (rule.camera === camera || rule.camera === ""),
  );
}
