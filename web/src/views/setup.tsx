// SPDX-License-Identifier: Apache-2.0
// The session: proposed from the images, then its text and the target's, with the target drawn.
import { useEffect, useState } from "preact/hooks";
import { ask } from "../api/client";
import type { Files, Session } from "../api/types";
import { usePicture } from "../parts/picture";
import { Cameras } from "../live/cameras";
import { Upload } from "../parts/upload";
import { activeJob, addJob, attempt, project, redo, session, undo } from "../state/project";

/** Where pictures go before there is a session. */
const kFirstCamera = [{ camera: "camera", folder: "camera" }];

function Folder() {
  const [files, setFiles] = useState<Files | null>(null);
  const look = () => attempt(async () => setFiles(await ask<Files>("GET", "/api/files")));
  useEffect(() => void look(), []);
  if (!files) return null;
  const empty = files.images === 0 && files.entries.every((entry) => entry.count === 0);
  return (
    <>
    <Upload done={look} />
    <Cameras places={kFirstCamera} done={look} />
    <section>
      <h2>Images in this folder</h2>
      <ul>
        {empty && <li>none yet</li>}
        {files.images > 0 && <li>{files.images} images in the folder itself</li>}
        {files.entries.filter((entry) => entry.count > 0).map((entry) => (
          <li key={entry.name}>
            {entry.name}: {entry.kind === "recording" ? "a recording" : `${entry.count} images`}
          </li>
        ))}
      </ul>
      <p>Cameras, their images and the target are looked for. You can change all of it afterwards.</p>
      <button class="main" disabled={empty || activeJob.value !== null} onClick={() => addJob("init")}>
        Propose a session
      </button>
    </section>
    </>
  );
}

interface Drawing {
  folder: string;
  sheets: string[];
  why: string | null;
}

function Sheet({ path }: { path: string }) {
  const url = usePicture(path, true);
  return url ? <img class="target" src={url} alt="the target" /> : null;
}

function TargetDrawing({ text }: { text: string | null }) {
  const [drawing, setDrawing] = useState<Drawing>({ folder: "", sheets: [], why: null });
  useEffect(() => void attempt(async () => setDrawing(await ask<Drawing>("POST", "/api/drawing", {}))), [text]);
  return (
    <div class="row">
      {drawing.why && <p class="quiet">{drawing.why}</p>}
      {drawing.sheets.map((sheet) => (
        <Sheet key={drawing.folder + sheet} path={`/api/drawing/${drawing.folder}/${encodeURIComponent(sheet)}`} />
      ))}
    </div>
  );
}

interface Editor {
  title: string;
  text: string;
  save: (text: string) => Promise<void>;
}

function TextEditor({ title, text, save }: Editor) {
  const [mine, setMine] = useState(text);
  const [base, setBase] = useState(text);
  useEffect(() => {
    // A text that was not touched follows the file.
    if (mine === base) setMine(text);
    setBase(text);
  }, [text]);
  const changed = mine !== base;
  return (
    <section class="editor">
      <h2>{title}</h2>
      <textarea
        aria-label={title}
        spellcheck={false}
        rows={Math.min(30, mine.split("\n").length + 1)}
        value={mine}
        onInput={(event) => setMine(event.currentTarget.value)}
      />
      <div class="row">
        <button disabled={!changed} onClick={() => save(mine)}>
          Save
        </button>
        <button disabled={!changed} onClick={() => setMine(base)}>
          Take back
        </button>
      </div>
    </section>
  );
}

export function SetUp() {
  const state = project.value;
  const now = session.value;
  if (state && !state.session) return <Folder />;
  if (!now) return <p>…</p>;
  const put = (path: string) => (text: string) =>
    attempt(async () => {
      session.value = await ask<Session>("PUT", path, { text }, path === "/api/session" ? now.hash : "");
    });
  return (
    <>
      {now.problem ? (
        <p class="problem" role="alert">
          {now.problem}
        </p>
      ) : (
        <p>
          {now.cameras.map((camera) => `${camera.name}: ${camera.frames.length} images, ${camera.model}`).join(" · ")}
        </p>
      )}
      <div class="row">
        <button class="main" disabled={now.problem !== null || activeJob.value !== null} onClick={() => addJob("calibrate")}>
          Calibrate
        </button>
        <button disabled={now.problem !== null || activeJob.value !== null} onClick={() => addJob("detect")}>
          Only detect
        </button>
        <button disabled={!now.undo} onClick={undo}>
          Undo
        </button>
        <button disabled={!now.redo} onClick={redo}>
          Redo
        </button>
      </div>
      <div class="columns">
        <TextEditor key="session" title="Session" text={now.text} save={put("/api/session")} />
        {now.target_text !== null && (
          <div>
            <TextEditor key="target" title={`Target (${now.target ?? ""})`} text={now.target_text} save={put("/api/session/target")} />
            {now.problem === null && <TargetDrawing text={now.target_text} />}
          </div>
        )}
      </div>
    </>
  );
}
