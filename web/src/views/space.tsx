// SPDX-License-Identifier: Apache-2.0
// Target and camera poses in space.
import { useEffect, useMemo, useRef, useState } from "preact/hooks";
import { ask } from "../api/client";
import type { Space, Transform } from "../api/types";
import { viridis } from "../plot/viridis";
import { attempt, go, place, run } from "../state/project";

type Vector = [number, number, number];

interface Camera {
  camera: string;
  frame: string;
  rms: number;
  apex: Vector;
  base: Vector[];
}
interface Turn {
  yaw: number;
  pitch: number;
  zoom: number;
  x: number;
  y: number;
}
interface Drawn {
  camera: Camera;
  x: number;
  y: number;
}

function apply(T: Transform, p: Vector): Vector {
  const row = (r: number): number =>
    (T[4 * r] ?? 0) * p[0] + (T[4 * r + 1] ?? 0) * p[1] + (T[4 * r + 2] ?? 0) * p[2] + (T[4 * r + 3] ?? 0);
  return [row(0), row(1), row(2)];
}

/** Middle of points and a radius that holds them. */
function extent(points: Vector[]): { middle: Vector; radius: number } {
  const range = ([0, 1, 2] as const).map((k) => {
    let low = Infinity;
    let high = -Infinity;
    for (const p of points) {
      low = Math.min(low, p[k]);
      high = Math.max(high, p[k]);
    }
    return [low, high] as const;
  });
  const middle = range.map(([a, b]) => (a + b) / 2) as Vector;
  return { middle, radius: Math.hypot(...range.map(([a, b]) => b - a)) / 2 || 1 };
}

/** What is drawn, in the target's frame. */
interface World {
  markers: Vector[];
  cameras: Camera[];
  middle: Vector;
  radius: number;
}

function worldOf(space: Space): World {
  const apexes = space.frames.map((frame) => apply(frame.T_target_rig, [0, 0, 0]));
  const { middle, radius } = extent([...space.markers, ...apexes]);
  return { markers: space.markers, cameras: camerasOf(space, 0.04 * radius), middle, radius };
}

function camerasOf(space: Space, size: number): Camera[] {
  const rms = new Map<string, number>();
  for (const camera of run.value?.cameras ?? []) {
    for (const frame of camera.frames) rms.set(`${camera.name}/${frame.frame}`, frame.rms ?? NaN);
  }
  return space.frames.flatMap((frame) =>
    space.cameras.map(({ name, T_rig_camera }) => {
      const at = (p: Vector): Vector => apply(frame.T_target_rig, apply(T_rig_camera, p));
      const corners: [number, number][] = [[-1, -0.75], [1, -0.75], [1, 0.75], [-1, 0.75]];
      return {
        camera: name,
        frame: frame.name,
        rms: rms.get(`${name}/${frame.name}`) ?? NaN,
        apex: at([0, 0, 0]),
        base: corners.map(([x, y]) => at([x * size, y * size, 1.6 * size])),
      };
    }),
  );
}

/** 0.05 to 1 px on the scale that is made for 0.01 to 10 px, in steps: one path a colour. */
function stepOf(rms: number): number {
  const part = Math.log(rms / 0.05) / Math.log(20);
  return Number.isFinite(part) ? Math.round(16 * Math.min(1, Math.max(0, part))) : -1;
}

function draw(element: HTMLCanvasElement, world: World, turn: Turn, hover: string): Drawn[] {
  const canvas = element.getContext("2d");
  if (!canvas) return [];
  const dots = window.devicePixelRatio || 1;
  const [width, height] = [element.clientWidth, element.clientHeight];
  element.width = width * dots;
  element.height = height * dots;
  canvas.setTransform(dots, 0, 0, dots, 0, 0);
  const style = getComputedStyle(document.documentElement);
  const { middle, radius } = world;
  const [cy, sy, cp, sp] = [Math.cos(turn.yaw), Math.sin(turn.yaw), Math.cos(turn.pitch), Math.sin(turn.pitch)];
  const scale = (0.5 * Math.min(width, height) * turn.zoom) / radius;
  const project = (p: Vector): [number, number] => {
    const [x, y, z] = [p[0] - middle[0], p[1] - middle[1], p[2] - middle[2]];
    const [u, d] = [cy * x + sy * z, cy * z - sy * x];
    // Perspective of an eye at 3.5 radii.
    const f = (3.5 * radius) / (3.5 * radius + sp * y + cp * d);
    return [width / 2 + turn.x + scale * u * f, height / 2 + turn.y + scale * (cp * y - sp * d) * f];
  };
  canvas.fillStyle = style.getPropertyValue("--text");
  for (const marker of world.markers) {
    const [x, y] = project(marker);
    canvas.fillRect(x - 1, y - 1, 2, 2);
  }
  const paths = new Map<number, Path2D>();
  const drawn = world.cameras.map((camera) => {
    const apex = project(camera.apex);
    const base = camera.base.map(project);
    const step = stepOf(camera.rms);
    const path = paths.get(step) ?? new Path2D();
    paths.set(step, path);
    base.forEach((corner, i) => {
      path.moveTo(...apex);
      path.lineTo(...corner);
      path.lineTo(...(base[(i + 1) % base.length] ?? corner));
    });
    return { camera, x: apex[0], y: apex[1] };
  });
  canvas.lineWidth = 1.2;
  for (const [step, path] of paths) {
    canvas.strokeStyle = step < 0 ? style.getPropertyValue("--line") : `rgb(${viridis(step / 16).join(",")})`;
    canvas.stroke(path);
  }
  const named = drawn.find(({ camera }) => `${camera.camera}/${camera.frame}` === hover);
  if (named) {
    canvas.strokeStyle = style.getPropertyValue("--accent");
    canvas.strokeRect(named.x - 7, named.y - 7, 14, 14);
  }
  return drawn;
}

const kFront: Turn = { yaw: 0.6, pitch: -0.35, zoom: 0.9, x: 0, y: 0 };

export function InSpace() {
  const element = useRef<HTMLCanvasElement>(null);
  const drawn = useRef<Drawn[]>([]);
  const [space, setSpace] = useState<Space | null>(null);
  const world = useMemo(() => (space ? worldOf(space) : null), [space, run.value]);
  const [turn, setTurn] = useState<Turn>(kFront);
  const [hover, setHover] = useState("");
  const [width, setWidth] = useState(0);
  const moved = useRef(0);
  const number = place.value.run;
  useEffect(() => {
    if (number === null) return;
    void attempt(async () => setSpace(await ask("GET", `/api/runs/${number}/space`)));
  }, [number]);
  useEffect(() => {
    if (!element.current) return;
    const watch = new ResizeObserver(() => setWidth(element.current?.clientWidth ?? 0));
    watch.observe(element.current);
    return () => watch.disconnect();
  }, [space]);
  useEffect(() => {
    if (element.current && world && width > 0) drawn.current = draw(element.current, world, turn, hover);
  }, [world, turn, hover, width]);
  if (number === null) return <p>No result yet: calibrate in Set up.</p>;
  if (!space) return <p>…</p>;
  const nearest = (x: number, y: number): Camera | null => {
    let best: Drawn | null = null;
    let least = 14; // px
    for (const each of drawn.current) {
      const distance = Math.hypot(each.x - x, each.y - y);
      if (distance >= least) continue;
      best = each;
      least = distance;
    }
    return best ? best.camera : null;
  };
  const onMove = (event: PointerEvent): void => {
    if (event.buttons === 0) {
      const found = nearest(event.offsetX, event.offsetY);
      setHover(found ? `${found.camera}/${found.frame}` : "");
      return;
    }
    moved.current += Math.hypot(event.movementX, event.movementY);
    if (event.buttons === 2 || event.shiftKey) {
      setTurn({ ...turn, x: turn.x + event.movementX, y: turn.y + event.movementY });
    } else {
      setTurn({ ...turn, yaw: turn.yaw + event.movementX / 150, pitch: turn.pitch + event.movementY / 150 });
    }
  };
  const onClick = (event: MouseEvent): void => {
    const found = moved.current < 4 ? nearest(event.offsetX, event.offsetY) : null;
    if (found) go("look", [found.camera, found.frame], number);
  };
  const zoom = (factor: number): void => setTurn({ ...turn, zoom: Math.min(50, Math.max(0.2, turn.zoom * factor)) });
  return (
    <>
      <div class="row">
        <button onClick={() => setTurn({ ...kFront, yaw: 0, pitch: 0 })}>front</button>
        <button onClick={() => setTurn({ ...kFront, yaw: Math.PI / 2, pitch: 0 })}>side</button>
        <button onClick={() => setTurn({ ...kFront, yaw: 0, pitch: -Math.PI / 2 })}>above</button>
        <button aria-label="nearer" onClick={() => zoom(1.4)}>+</button>
        <button aria-label="farther" onClick={() => zoom(1 / 1.4)}>−</button>
        <span class="quiet" aria-live="polite" data-hover={hover}>
          {hover || `${space.frames.length} frames`}
        </span>
      </div>
      <canvas
        ref={element}
        class="space"
        role="img"
        aria-label="target and camera poses"
        data-cameras={space.frames.length * space.cameras.length}
        onPointerDown={() => (moved.current = 0)}
        onPointerMove={onMove}
        onClick={onClick}
        onContextMenu={(event) => event.preventDefault()}
        onWheel={(event) => {
          event.preventDefault();
          zoom(Math.exp(-event.deltaY / 300));
        }}
      />
    </>
  );
}
