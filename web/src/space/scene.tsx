// SPDX-License-Identifier: Apache-2.0
// Target and camera poses in space: a drag turns, Shift or the right button moves, hover names, a click opens.
import { useLayoutEffect, useMemo, useRef, useState } from "preact/hooks";
import { brief } from "../base/numbers";
import { drawWhenNear } from "../plot/figures";
import { ColourScale, Keys } from "../plot/figure";
import { fitted, rigWorld, wholeWorld } from "./geometry";
import type { Ghost, SceneCamera, ScenePose, Turn, Vector } from "./geometry";
import { kRmsScale, paintScene } from "./paint";
import type { Place, Shown } from "./paint";

interface SceneLook {
  markers: Vector[];
  cameras: SceneCamera[];
  frames: ScenePose[];
  /** RMS of a frame in a camera, px: colours of the cameras. */
  rms?: (camera: string, frame: string) => number | null;
  byRms?: boolean;
  /** Further poses, dashed. */
  ghosts?: Ghost[];
  onOpen?: (camera: string, frame: string) => void;
  /** The wheel zooms, where the page has no need of it. */
  wheel?: boolean;
}

// So many cameras turn in 50 ms without a graphics card; of more every k-th is drawn until the pointer rests.
const kMostTurning = 1000;
const kRest = 150; // ms
const kReach = 14; // px, of the pointer
const kFront = { yaw: 0.6, pitch: -0.35 };
const kSides: [string, { yaw: number; pitch: number }][] = [
  ["front", { yaw: 0, pitch: 0 }],
  ["side", { yaw: Math.PI / 2, pitch: 0 }],
  ["above", { yaw: 0, pitch: -Math.PI / 2 }],
];

export function Scene({ markers, cameras, frames, rms, byRms = false, ghosts = [], onOpen, wheel }: SceneLook) {
  const element = useRef<HTMLCanvasElement>(null);
  const [alone, setAlone] = useState(false);
  const [coloured, setColoured] = useState(byRms);
  const [pose, setPose] = useState(-1);
  const [hover, setHover] = useState<Place | null>(null);
  const world = useMemo(() => (alone ? rigWorld(cameras) : wholeWorld(markers, cameras, frames)), [alone, markers, cameras, frames]);
  const turn = useRef<Turn | null>(null);
  const places = useRef<Place[]>([]);
  const way = useRef(0);
  const waiting = useRef({ frame: 0, rest: 0 });
  const rmsOf = useMemo(() => {
    if (!coloured || !rms || alone) return null;
    const table = frames.map((frame) => cameras.map((camera) => rms(camera.name, frame.name)));
    return (i: number, camera: number): number | null => table[i]?.[camera] ?? null;
  }, [coloured, rms, alone, frames, cameras]);

  const shown = useRef<Omit<Shown, "turn" | "every"> | null>(null);
  shown.current = { world, cameras, named: alone, ghosts: alone ? [] : ghosts, rms: rmsOf, pose: alone ? -1 : pose, hover };
  const draw = (every: number): void => {
    const canvas = element.current;
    if (!canvas || canvas.clientWidth === 0 || !shown.current) return;
    turn.current ??= fitted(shown.current.world, kFront, canvas.clientWidth, canvas.clientHeight);
    places.current = paintScene(canvas, { ...shown.current, turn: turn.current, every });
  };
  const drawMoving = (): void => {
    const { current } = waiting;
    clearTimeout(current.rest);
    current.rest = window.setTimeout(() => draw(1), kRest);
    if (current.frame !== 0) return;
    current.frame = requestAnimationFrame(() => {
      current.frame = 0;
      draw(Math.ceil((world.pyramids.length * cameras.length) / kMostTurning));
    });
  };
  const drawNow = useRef(draw);
  drawNow.current = draw;
  useLayoutEffect(() => {
    const canvas = element.current;
    if (!canvas) return;
    const redraw = (): void => drawNow.current(1);
    const end = drawWhenNear(canvas, {
      title: "Target and camera poses",
      count: markers.length + frames.length * cameras.length,
      canvas: () => canvas,
      draw: redraw,
      redraw,
    });
    const watch = new ResizeObserver(redraw);
    watch.observe(canvas);
    return () => {
      end();
      watch.disconnect();
      clearTimeout(waiting.current.rest);
    };
  }, []);
  useLayoutEffect(() => {
    turn.current = null;
    draw(1);
  }, [world]);
  useLayoutEffect(() => draw(1), [pose, hover, rmsOf, ghosts]);

  const view = (side: { yaw: number; pitch: number }): void => {
    const canvas = element.current;
    if (!canvas) return;
    turn.current = fitted(world, side, canvas.clientWidth, canvas.clientHeight);
    draw(1);
  };
  const change = (by: (now: Turn) => Partial<Turn>): void => {
    if (!turn.current) return;
    turn.current = { ...turn.current, ...by(turn.current) };
    drawMoving();
  };
  const rotate = (yaw: number, pitch: number): void =>
    change((now) => ({ yaw: now.yaw + yaw, pitch: Math.min(Math.max(now.pitch + pitch, -Math.PI / 2), Math.PI / 2) }));
  const zoom = (factor: number): void =>
    change((now) => ({ zoom: Math.min(50, Math.max(0.1, now.zoom * factor)), shift: [now.shift[0] * factor, now.shift[1] * factor] }));
  const nearest = (x: number, y: number): Place | null => {
    let best: Place | null = null;
    let least = kReach;
    for (const place of places.current) {
      const distance = Math.hypot(place.x - x, place.y - y);
      if (distance >= least) continue;
      best = place;
      least = distance;
    }
    return best;
  };
  const nameOf = (place: Place): string => `${cameras[place.camera]?.name}/${frames[place.pose]?.name}`;
  const onMove = (event: PointerEvent): void => {
    if (event.buttons === 0) {
      const found = alone ? null : nearest(event.offsetX, event.offsetY);
      if (found?.pose !== hover?.pose || found?.camera !== hover?.camera) setHover(found);
      return;
    }
    way.current += Math.hypot(event.movementX, event.movementY);
    if (event.buttons !== 2 && !event.shiftKey) return rotate(event.movementX / 150, event.movementY / 150);
    const canvas = element.current;
    const radius = canvas ? 0.5 * Math.min(canvas.clientWidth, canvas.clientHeight) : 1;
    change((now) => ({ shift: [now.shift[0] - event.movementX / radius, now.shift[1] - event.movementY / radius] }));
  };
  const onClick = (event: MouseEvent): void => {
    const found = way.current < 4 && !alone ? nearest(event.offsetX, event.offsetY) : null;
    const camera = found && cameras[found.camera];
    const frame = found && frames[found.pose];
    if (!found || !camera || !frame) return;
    if (onOpen) onOpen(camera.name, frame.name);
    else setPose(found.pose);
  };
  const kKeys: Record<string, () => void> = {
    ArrowLeft: () => rotate(-0.1, 0),
    ArrowRight: () => rotate(0.1, 0),
    ArrowUp: () => rotate(0, -0.1),
    ArrowDown: () => rotate(0, 0.1),
    "+": () => zoom(1.25),
    "-": () => zoom(1 / 1.25),
  };
  const onKey = (event: KeyboardEvent): void => {
    const act = kKeys[event.key];
    if (!act) return;
    event.preventDefault();
    event.stopPropagation();
    act();
  };
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
          zoom(Math.exp(-event.deltaY / 300));
        }}
      />
      {rmsOf ? (
        <ColourScale low={`RMS ${brief(kRmsScale[0])} px`} high={`${brief(kRmsScale[1])} px`} />
      ) : (
        <Keys keys={cameras.map(({ name }, i) => ({ label: name, colour: `--series-${i % 8}` }))} />
      )}
      <div class="row controls">
        {kSides.map(([name, side]) => (
          <button key={name} title={`seen from: ${name}`} onClick={() => view(side)}>
            {name}
          </button>
        ))}
        <button aria-label="nearer" onClick={() => zoom(1.4)}>+</button>
        <button aria-label="farther" onClick={() => zoom(1 / 1.4)}>−</button>
        {cameras.length > 1 && (
          <button aria-pressed={alone} title="the rig alone, or with the target" onClick={() => setAlone(!alone)}>
            rig
          </button>
        )}
        {rms && (
          <button aria-pressed={coloured} title="colour: RMS of the frame, or the camera" onClick={() => setColoured(!coloured)}>
            RMS
          </button>
        )}
        <label>
          frame
          <input type="range" min={-1} max={frames.length - 1} value={pose} onInput={(event) => setPose(Number(event.currentTarget.value))} />
        </label>
        <span class="quiet" aria-live="polite" data-hover={hover ? nameOf(hover) : ""}>
          {hover ? nameOf(hover) : pose >= 0 ? frames[pose]?.name : `${frames.length} frames`}
        </span>
      </div>
    </>
  );
}
