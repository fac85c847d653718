// SPDX-License-Identifier: Apache-2.0
// Target and camera poses in space: a drag turns, Shift or the right button moves, hover names, a click opens.
import { useMemo, useRef, useState } from "preact/hooks";
import { brief } from "../base/numbers";
import { lineRamp, seriesName } from "../plot/colours";
import { ColourScale, Keys } from "../plot/figure";
import { useSceneCanvas } from "./canvas";
import type { SceneCanvas } from "./canvas";
import { rigWorld, wholeWorld } from "./geometry";
import type { Ghost, SceneCamera, ScenePose, Side, Vector } from "./geometry";
import { kRmsScale } from "./paint";
import type { Place } from "./paint";

interface SceneLook {
  markers: Vector[];
  cameras: SceneCamera[];
  frames: ScenePose[];
  /** RMS of a frame in a camera, px: colours of the cameras. */
  rms?: (camera: string, frame: string) => number | null;
  byRms?: boolean;
  /** Further poses, dashed. */
  ghosts?: Ghost[];
  /** Of the markers, from their nominal positions, m; empty: not known. */
  displacements?: Vector[];
  /** What a click does; without it the frame is chosen. */
  onOpen?: (camera: string, frame: string) => void;
  /** The wheel zooms, where the page has no need of it; elsewhere with Ctrl. */
  wheel?: boolean;
}

const kNoGhosts: Ghost[] = [];
const kNoVectors: Vector[] = [];
const kMostNames = 30; // of more, names hide the scene
const kMagnify = [0, 10, 100, 1000];
const kSides: [string, Side][] = [
  ["front", { yaw: 0, pitch: 0 }],
  ["side", { yaw: Math.PI / 2, pitch: 0 }],
  ["above", { yaw: 0, pitch: -Math.PI / 2 }],
];

function keysOf({ rotate, zoom }: SceneCanvas): Record<string, () => void> {
  return {
    ArrowLeft: () => rotate(-0.1, 0),
    ArrowRight: () => rotate(0.1, 0),
    ArrowUp: () => rotate(0, -0.1),
    ArrowDown: () => rotate(0, 0.1),
    "+": () => zoom(1.25),
    "-": () => zoom(1 / 1.25),
  };
}

interface Toggle {
  name: string;
  title: string;
  on: boolean;
  set: (on: boolean) => void;
}

function Views({ canvas, toggles }: { canvas: SceneCanvas; toggles: Toggle[] }) {
  return (
    <>
      {kSides.map(([name, side]) => (
        <button key={name} title={`seen from: ${name}`} onClick={() => canvas.view(side)}>
          {name}
        </button>
      ))}
      <button aria-label="nearer" onClick={() => canvas.zoom(1.4)}>+</button>
      <button aria-label="farther" onClick={() => canvas.zoom(1 / 1.4)}>−</button>
      {toggles.map(({ name, title, on, set }) => (
        <button key={name} aria-pressed={on} title={title} onClick={() => set(!on)}>
          {name}
        </button>
      ))}
    </>
  );
}

export function Scene({ markers, cameras, frames, rms, byRms = false, ghosts = kNoGhosts, displacements = kNoVectors, onOpen, wheel }: SceneLook) {
  const element = useRef<HTMLCanvasElement>(null);
  const [alone, setAlone] = useState(false);
  const [named, setNamed] = useState(frames.length <= kMostNames);
  const [coloured, setColoured] = useState(byRms);
  const [pose, setPose] = useState(-1);
  const [magnify, setMagnify] = useState(0);
  const [hover, setHover] = useState<Place | null>(null);
  const way = useRef(0);
  const world = useMemo(() => (alone ? rigWorld(cameras) : wholeWorld(markers, cameras, frames)), [alone, markers, cameras, frames]);
  const rmsOf = useMemo(() => {
    if (!coloured || !rms || alone) return null;
    const table = frames.map((frame) => cameras.map((camera) => rms(camera.name, frame.name)));
    return (i: number, camera: number): number | null => table[i]?.[camera] ?? null;
  }, [coloured, rms, alone, frames, cameras]);
  const names = useMemo(() => frames.map(({ name }) => name), [frames]);
  const canvas = useSceneCanvas(element, {
    world,
    cameras,
    named: alone ? "cameras" : named ? "frames" : null,
    frames: names,
    ghosts: alone ? kNoGhosts : ghosts,
    displacements: alone ? kNoVectors : displacements,
    magnify,
    rms: rmsOf,
    pose: alone ? -1 : pose,
    hover,
  });
  const cameraAt = (event: MouseEvent): Place | null => (alone ? null : canvas.nearest(event.offsetX, event.offsetY));
  const nameOf = (place: Place): string => `${cameras[place.camera]?.name}/${frames[place.pose]?.name}`;
  const onMove = (event: PointerEvent): void => {
    if (event.buttons === 0) {
      const found = cameraAt(event);
      if (found?.pose !== hover?.pose || found?.camera !== hover?.camera) setHover(found);
      return;
    }
    way.current += Math.hypot(event.movementX, event.movementY);
    if (event.buttons === 2 || event.shiftKey) canvas.move(event.movementX, event.movementY);
    else canvas.rotate(event.movementX / 150, event.movementY / 150);
  };
  const onClick = (event: MouseEvent): void => {
    const found = way.current < 4 ? cameraAt(event) : null;
    const camera = found && cameras[found.camera];
    const frame = found && frames[found.pose];
    if (!camera || !frame) return;
    if (onOpen) onOpen(camera.name, frame.name);
    else setPose(found.pose);
  };
  const onKey = (event: KeyboardEvent): void => {
    const act = keysOf(canvas)[event.key];
    if (!act) return;
    event.preventDefault();
    event.stopPropagation();
    act();
  };
  const toggles = [
    { name: "rig", title: "the rig alone, or with the target", on: alone, set: setAlone, use: cameras.length > 1 },
    { name: "names", title: "names of the frames", on: named, set: setNamed, use: !alone },
    { name: "RMS", title: "colour: RMS of the frame, or the camera", on: coloured, set: setColoured, use: rms !== undefined },
  ];
  return (
    <>
      <canvas
        ref={element}
        class="space"
        tabIndex={0}
        role="img"
        aria-label="target and camera poses; arrow keys turn, + and - zoom"
        data-cameras={frames.length * cameras.length}
        onPointerDown={(event) => {
          way.current = 0;
          element.current?.setPointerCapture(event.pointerId);
        }}
        onPointerMove={onMove}
        onPointerLeave={() => setHover(null)}
        onClick={onClick}
        onKeyDown={onKey}
        onContextMenu={(event) => event.preventDefault()}
        onWheel={(event) => {
          if (!wheel && !event.ctrlKey) return;
          event.preventDefault();
          canvas.zoom(Math.exp(-event.deltaY / 300));
        }}
      />
      {rmsOf ? (
        <ColourScale low={`RMS ${brief(kRmsScale[0])} px`} high={`${brief(kRmsScale[1])} px`} colour={lineRamp} />
      ) : (
        <Keys keys={cameras.map(({ name }, i) => ({ label: name, colour: seriesName(i) }))} />
      )}
      <div class="row controls">
        <Views canvas={canvas} toggles={toggles.filter(({ use }) => use)} />
        <label>
          frame
          <input type="range" min={-1} max={frames.length - 1} value={pose} onInput={(event) => setPose(Number(event.currentTarget.value))} />
        </label>
        {displacements.length > 0 && (
          <label title="from the nominal to the refined positions of the markers">
            displacement ×
            <select value={magnify} onChange={(event) => setMagnify(Number(event.currentTarget.value))}>
              {kMagnify.map((value) => (
                <option key={value} value={value}>
                  {value}
                </option>
              ))}
            </select>
          </label>
        )}
        <span class="quiet" aria-live="polite" data-hover={hover ? nameOf(hover) : ""}>
          {hover ? nameOf(hover) : pose >= 0 ? frames[pose]?.name : `${frames.length} frames`}
        </span>
      </div>
    </>
  );
}
