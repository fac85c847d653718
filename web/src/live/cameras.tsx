// SPDX-License-Identifier: Apache-2.0
// Cameras that the browser opens: their pictures become files in the folders of the session's cameras.
import { signal } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import { ask, send } from "../api/client";
import type { Renewed, Worth } from "../api/types";
import { activeJob, attempt, renewed, report, run } from "../state/project";
import { Stillness } from "./still";

/** A camera of the session, and the folder that its images come from; null: from elsewhere. */
export interface Place {
  camera: string;
  folder: string | null;
}
type Outline = [number, number][];

const kLook = 200; // ms between two looks at a video
const kPace = 1000; // ms between two views whose worth is shown

/** Videos that run, by folder. */
const videos = new Map<string, { camera: string; video: HTMLVideoElement; stillness: Stillness }>();
const open = signal(0); // how many of them
const taken = signal<{ count: number; last: string }>({ count: 0, last: "" });
const automatic = signal(false);
const least = signal(60); // per cent of what the best view adds, for a view to be kept by itself
/** Of what the cameras showed last; null: not known, as before the first calibration. */
const worth = signal<Worth | null>(null);
let turn: Promise<void> = Promise.resolve(); // of the work with pictures, one after the other
let busy = 0; // how much of it there is
let judged = 0; // when, ms

/** "20261125_142233_417": names of one recording are in its order. */
function stamp(): string {
  const now = new Date();
  const two = (value: number, digits = 2) => String(value).padStart(digits, "0");
  const day = `${now.getFullYear()}${two(now.getMonth() + 1)}${two(now.getDate())}`;
  return `${day}_${two(now.getHours())}${two(now.getMinutes())}${two(now.getSeconds())}_${two(now.getMilliseconds(), 3)}`;
}

function pictureOf(video: HTMLVideoElement): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  canvas.width = video.videoWidth;
  canvas.height = video.videoHeight;
  canvas.getContext("2d")?.drawImage(video, 0, 0);
  return canvas;
}

interface Picture {
  folder: string;
  camera: string;
  file: Blob;
}

/** What all open cameras show now, as PNG files. */
async function pictures(): Promise<Picture[]> {
  // All of them before any is encoded, so that they are of one moment.
  const now = [...videos].map(([folder, { camera, video }]) => ({ folder, camera, canvas: pictureOf(video) }));
  return Promise.all(
    now.map(async ({ folder, camera, canvas }) => {
      const file = await new Promise<Blob | null>((done) => canvas.toBlob(done, "image/png"));
      if (!file) throw new Error("the browser cannot encode the picture");
      return { folder, camera, file };
    }),
  );
}

/** The files of one moment have one name. */
async function keep(moment: Picture[]): Promise<string> {
  const frame = stamp();
  const name = `${frame}.png`;
  for (const { folder, file } of moment) await send(`/api/files?${new URLSearchParams({ dir: folder, name })}`, file);
  taken.value = { count: taken.value.count + 1, last: name };
  return frame;
}

/** Against the run that is shown; null where there is none. */
async function weigh(moment: Picture[]): Promise<Worth | null> {
  if (!run.value) return null;
  const sizes = moment.map(({ camera, file }) => `${camera}:${file.size}`).join(",");
  const query = new URLSearchParams({ run: String(run.value.run), pictures: sizes });
  return send<Worth>(`/api/look?${query}`, new Blob(moment.map(({ file }) => file)));
}

function inTurn(work: () => Promise<void>): Promise<void> {
  ++busy;
  turn = turn.then(work).finally(() => void --busy);
  return turn;
}

/** The calibration goes on with the picture that was weighed last. */
async function renew(frame: string): Promise<void> {
  renewed.value = await ask<Renewed | null>("POST", "/api/look/keep", { frame });
}

const take = (): Promise<void> =>
  inTurn(() =>
    attempt(async () => {
      const moment = await pictures();
      const frame = await keep(moment);
      worth.value = await weigh(moment);
      if (worth.value) await renew(frame);
    }),
  );

/** Shows what the present view adds; `mayKeep`: and keeps it when it is worth it, or when there is no calibration yet. */
const judge = (mayKeep: boolean): Promise<void> =>
  inTurn(async () => {
    try {
      if (mayKeep) for (const { stillness } of videos.values()) stillness.seen();
      const moment = await pictures();
      worth.value = await weigh(moment);
      judged = Date.now();
      if (!mayKeep || (worth.value && 100 * (worth.value.share ?? 0) < least.value)) return;
      const frame = await keep(moment);
      if (worth.value) await renew(frame);
    } catch (error) {
      worth.value = null;
      report(error);
    }
  });

let looking = 0;
function lookAtVideos(): void {
  const looks = [...videos.values()].map(({ video, stillness }) => stillness.look(video));
  const mayKeep = automatic.value && looks.length > 0 && looks.every(Boolean);
  // A job has the machine for itself.
  const mayShow = run.value !== null && activeJob.value === null && Date.now() - judged > kPace;
  if (busy === 0 && (mayKeep || mayShow)) void judge(mayKeep);
}

/** Holds the focus where the browser can: a lens that focuses changes the camera. What is to be said about it. */
async function holdFocus(track: MediaStreamTrack): Promise<string> {
  const can = track.getCapabilities?.() as { focusMode?: string[] } | undefined;
  if (!can?.focusMode) return "";
  if (!can.focusMode.includes("manual")) return "switch its autofocus off: a lens that focuses changes the camera";
  const now = track.getSettings() as { focusDistance?: number };
  const manual = { focusMode: "manual", ...(now.focusDistance === undefined ? {} : { focusDistance: now.focusDistance }) };
  await track.applyConstraints({ advanced: [manual as MediaTrackConstraintSet] });
  return "its focus is held";
}

function why(error: unknown): string {
  const name = error instanceof DOMException ? error.name : "";
  if (name === "NotAllowedError") return "the browser does not let this page use the camera: allow it beside the address";
  if (name === "NotFoundError") return "this machine has no camera";
  if (name === "NotReadableError") return "another program uses the camera";
  return error instanceof Error ? error.message : String(error);
}

interface Shown {
  stream: MediaStream;
  camera: string;
  folder: string;
  outlines: Outline[];
  size: [number, number] | null;
}

function Live({ stream, camera, folder, outlines, size }: Shown) {
  const element = useRef<HTMLVideoElement>(null);
  useEffect(() => {
    const video = element.current;
    if (!video) return;
    video.srcObject = stream;
    videos.set(folder, { camera, video, stillness: new Stillness() });
    if (videos.size === 1) looking = window.setInterval(lookAtVideos, kLook);
    open.value = videos.size;
    return () => {
      videos.delete(folder);
      if (videos.size === 0) window.clearInterval(looking);
      open.value = videos.size;
      worth.value = renewed.value = null;
    };
  }, [stream, folder]);
  return (
    <div class="live">
      <video ref={element} autoplay muted playsInline aria-label={`live image for ${folder}`} />
      {size && outlines.length > 0 && (
        <svg viewBox={`0 0 ${size[0]} ${size[1]}`} aria-label="where the target should be next">
          {outlines.map((outline, i) => (
            <polygon key={i} points={outline.map(([x, y]) => `${x},${y}`).join(" ")} />
          ))}
        </svg>
      )}
    </div>
  );
}

function Device({ place, outlines, size }: { place: Place; outlines: Outline[]; size: [number, number] | null }) {
  const [stream, setStream] = useState<MediaStream | null>(null);
  const [devices, setDevices] = useState<MediaDeviceInfo[]>([]);
  const [device, setDevice] = useState("");
  const [state, setState] = useState("");
  const stop = (of: MediaStream | null) => of?.getTracks().forEach((track) => track.stop());
  useEffect(() => () => stop(stream), [stream]);
  const openDevice = async (id: string) => {
    setDevice(id);
    try {
      const most = { ideal: 16384 }; // px: the whole sensor
      const video = { width: most, height: most, resizeMode: "none", ...(id ? { deviceId: { exact: id } } : {}) } as MediaTrackConstraints;
      const opened = await navigator.mediaDevices.getUserMedia({ video, audio: false });
      const [track] = opened.getVideoTracks();
      const focus = track ? await holdFocus(track).catch(() => "") : "";
      const now = track?.getSettings();
      setState([`${now?.width ?? "?"} x ${now?.height ?? "?"} px`, focus].filter(Boolean).join("; "));
      setDevice(now?.deviceId ?? id);
      setDevices((await navigator.mediaDevices.enumerateDevices()).filter((each) => each.kind === "videoinput"));
      setStream(opened);
    } catch (error) {
      setState(why(error));
    }
  };
  if (place.folder === null) {
    return <p class="quiet">{place.camera}: pictures go into a folder of PNG files beneath this one; its images come from elsewhere.</p>;
  }
  return (
    <div>
      <div class="row">
        <b>{place.camera}</b>
        {stream ? (
          <>
            <select aria-label={`device of ${place.camera}`} value={device} onChange={(event) => void openDevice(event.currentTarget.value)}>
              {devices.map((each, i) => (
                <option key={each.deviceId} value={each.deviceId}>
                  {each.label || `camera ${i + 1}`}
                </option>
              ))}
            </select>
            <button
              onClick={() => {
                setStream(null);
                setState("");
              }}
            >
              Close
            </button>
          </>
        ) : (
          <button onClick={() => void openDevice("")}>Open a camera</button>
        )}
        <span class="quiet" aria-live="polite">
          {state}
        </span>
      </div>
      {stream && <Live stream={stream} camera={place.camera} folder={place.folder} outlines={outlines} size={size} />}
    </div>
  );
}

/** Gain of the present view, on a scale that ends at the best one. */
function Gain() {
  const now = worth.value;
  if (!now) return null;
  return (
    <p class="row" data-share={now.share ?? ""}>
      <meter min={0} max={1} low={least.value / 100} value={Math.min(1, now.share ?? 0)} aria-label="what this view adds, of what the best one would" />
      <span>{now.words}</span>
    </p>
  );
}

/** What the calibration is with the picture that was kept, or has arrived, last. */
export function Now() {
  const now = renewed.value;
  if (!now) return null;
  const cameras = Object.entries(now.calibration).map(([name, camera]) => {
    const [first] = camera.parameters;
    const value = first ? `${first[0]} ${first[1].toPrecision(6)} ± ${first[2]?.toPrecision(2) ?? "?"}, ` : "";
    return `${name}: ${value}points in ${(100 * camera.coverage).toFixed(0)} % of the image`;
  });
  const sigma = now.sigma_now === null ? "not everything is determined yet" : `sigma ${now.sigma_now.toPrecision(2)} px`;
  return (
    <p aria-live="polite" data-renewed={now.seconds}>
      {now.frames} frames, {sigma}; {now.bound ? `${now.bound.words}; ` : ""}
      {cameras.join("; ")} (looked at in {now.detection_seconds.toFixed(2)} s, renewed in{" "}
      {now.seconds.toFixed(2)} s)
    </p>
  );
}

/** `outlines`: where the target should be next, by camera. `done` is called after each picture. */
export function Cameras({
  places,
  outlines = {},
  sizes = {},
  done,
}: {
  places: Place[];
  outlines?: Record<string, Outline[]>;
  sizes?: Record<string, [number, number]>;
  done?: () => void;
}) {
  useEffect(() => {
    if (taken.value.count > 0) done?.();
  }, [taken.value]);
  useEffect(() => () => void (automatic.value = false), []);
  if (!navigator.mediaDevices) return null;
  return (
    <section>
      <h2>Cameras of this machine</h2>
      {places.map((place) => (
        <Device key={place.camera} place={place} outlines={outlines[place.camera] ?? []} size={sizes[place.camera] ?? null} />
      ))}
      <div class="row">
        <button disabled={open.value === 0} onClick={() => void take()}>
          Take a picture
        </button>
        <label>
          <input type="checkbox" checked={automatic.value} onChange={(event) => void (automatic.value = event.currentTarget.checked)} /> whenever the view is
          new and stands still
        </label>
        {run.value && (
          <label>
            and adds at least
            <input type="number" min={0} max={100} value={least.value} onInput={(event) => void (least.value = event.currentTarget.valueAsNumber || 0)} />% of
            what the best one would
          </label>
        )}
        <span class="quiet" aria-live="polite" data-taken={taken.value.count}>
          {taken.value.count > 0 ? `${taken.value.count} taken, the last one ${taken.value.last}` : "pictures become PNG files in the camera's folder"}
        </span>
      </div>
      <Gain />
    </section>
  );
}
