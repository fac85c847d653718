// SPDX-License-Identifier: Apache-2.0
// The session: proposed from the images, then its text and the target's with fields for what most users set, and the target drawn.
import { useEffect, useState } from "preact/hooks";
import { ask } from "../api/client";
import type { Field, Files, Session } from "../api/types";
import { Cameras } from "../live/cameras";
import { Fields, labelOf } from "../parts/fields";
import { usePicture } from "../parts/picture";
import { Upload } from "../parts/upload";
import { activeJob, addJob, attempt, changeSession, loadState, project, redo, session, undo } from "../state/project";

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
      <ol class="todo">
        <li>
          Add 10 to 30 images of a calibration target (such as a printed chessboard) from many sides and distances: one folder for each
          camera.
        </li>
        <li>Have a session proposed: cameras, their images and the target are looked for. You can change all of it afterwards.</li>
        <li>Measure the target, enter its size, and calibrate.</li>
      </ol>
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
  /** Whether there are changes that are not saved. */
  onChanged: (changed: boolean) => void;
}

function TextEditor({ title, text, save, onChanged }: Editor) {
  // What is typed, and the text of the file that it changes.
  const [edit, setEdit] = useState({ mine: text, base: text });
  const take = (other: string): void => setEdit({ mine: other, base: other });
  const changed = edit.mine !== edit.base && edit.mine !== text;
  // A text that was not touched follows the file, at once: an effect comes after the fields have changed.
  if (!changed && edit.base !== text) take(text);
  const { mine, base } = changed ? edit : { mine: text, base: text };
  const conflict = changed && text !== base;
  useEffect(() => onChanged(changed), [changed]);
  return (
    <section class="editor">
      <h2>{title}</h2>
      <textarea
        aria-label={title}
        spellcheck={false}
        rows={Math.min(30, mine.split("\n").length + 1)}
        value={mine}
        onInput={(event) => setEdit({ mine: event.currentTarget.value, base })}
      />
      {conflict && (
        <div class="problem" role="alert">
          The file has changed meanwhile:
          <pre>{text}</pre>
          <div class="row">
            <button onClick={() => take(text)}>Take the new text</button>
            <button onClick={() => setEdit({ mine, base: text })}>Keep mine</button>
          </div>
        </div>
      )}
      <div class="row">
        <button disabled={!changed || conflict} onClick={() => save(mine)}>
          Save
        </button>
        <button disabled={!changed} onClick={() => take(text)}>
          Revert
        </button>
      </div>
    </section>
  );
}

const wordsOf = (field: Field): string =>
  field.unit === "m" && field.path.length === 1
    ? `Measure the ${field.what} on the target, and enter it below (${labelOf(field)}).`
    : `State the ${field.what} (${labelOf(field)}).`;

/** What is missing, in plain words; else what is wrong with the texts; else what there is. */
function Summary({ now, missing }: { now: Session; missing: Field[] }) {
  if (missing.length > 0) {
    return (
      <div class="verdict usable" role="status">
        <strong>Before you can calibrate:</strong>
        {missing.map((field) => (
          <p key={field.path.join()}>{wordsOf(field)}</p>
        ))}
      </div>
    );
  }
  if (now.problem) {
    return (
      <p class="problem" role="alert">
        {now.problem}
      </p>
    );
  }
  return <p>{now.cameras.map((camera) => `${camera.name}: ${camera.frames.length} images, ${camera.model}`).join(" · ")}</p>;
}

export function SetUp() {
  const state = project.value;
  const now = session.value;
  const [unsaved, setUnsaved] = useState({ session: false, target: false });
  if (state && !state.session) return <Folder />;
  if (!now) return <p>…</p>;
  const part = (of: "session" | "target", title: string, text: string, path: string) => (
    <>
      <Fields
        fields={now.fields[of]}
        set={({ path }, value) => changeSession("POST", "/api/session/field", { of, path, value })}
        locked={unsaved[of] ? "Save or revert the text, then use the fields." : ""}
      />
      <TextEditor
        key={of}
        title={title}
        text={text}
        save={(mine) => changeSession("PUT", path, { text: mine }, of === "session" ? now.hash : "")}
        onChanged={(changed) => setUnsaved((all) => ({ ...all, [of]: changed }))}
      />
    </>
  );
  const missing = [...now.fields.session, ...now.fields.target].filter(({ required, value }) => required && !value);
  return (
    <>
      <Summary now={now} missing={missing} />
      <div class="row">
        <button class="main" disabled={now.problem !== null || activeJob.value !== null} onClick={() => addJob("calibrate")}>
          Calibrate
        </button>
        <button disabled={now.problem !== null || activeJob.value !== null} onClick={() => addJob("detect")}>
          Detect only
        </button>
        <button disabled={!now.undo} onClick={undo}>
          Undo
        </button>
        <button disabled={!now.redo} onClick={redo}>
          Redo
        </button>
      </div>
      <div class="columns">
        {now.target_text !== null && (
          <div>
            {part("target", `Target (${now.target ?? ""})`, now.target_text, "/api/session/target")}
            {now.problem === null && <TargetDrawing text={now.target_text} />}
          </div>
        )}
        <div>{part("session", "Session", now.text, "/api/session")}</div>
      </div>
      {now.cameras.length > 0 && <Upload cameras={now.cameras} done={() => attempt(loadState)} />}
    </>
  );
}
