// SPDX-License-Identifier: Apache-2.0
// The canvas of a scene: how it is turned, and when it is drawn.
import type { RefObject } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";
import { drawWhenNear } from "../plot/drawings";
import { fitted } from "./geometry";
import type { Side, Turn } from "./geometry";
import { paintScene } from "./paint";
import type { Place, Shown } from "./paint";

// So many cameras turn in 50 ms without a graphics card; of more every k-th is drawn until the pointer rests.
const kMostTurning = 1000;
const kRest = 150; // ms
const kReach = 14; // px, of the pointer
const kStart: Side = { yaw: 0.6, pitch: -0.35 };

export interface SceneCanvas {
  /** Seen from there, all of it. */
  view: (side: Side) => void;
  rotate: (yaw: number, pitch: number) => void;
  /** px. */
  move: (x: number, y: number) => void;
  zoom: (factor: number) => void;
  /** The camera at a place of the canvas. */
  nearest: (x: number, y: number) => Place | null;
}

export function useSceneCanvas(element: RefObject<HTMLCanvasElement>, shown: Omit<Shown, "turn" | "every">): SceneCanvas {
  const turn = useRef<Turn | null>(null);
  const places = useRef<Place[]>([]);
  const waiting = useRef({ frame: 0, rest: 0 });
  const latest = useRef(shown);
  latest.current = shown;
  const { world, cameras, ghosts, displacements, magnify, rms, pose, hover, named } = shown;

  const fit = (side: Side): void => {
    const canvas = element.current;
    if (canvas && canvas.clientWidth > 0) turn.current = fitted(latest.current.world, latest.current.ghosts, side, canvas.clientWidth, canvas.clientHeight);
  };
  const draw = (every = 1): void => {
    if (!turn.current) fit(kStart);
    if (element.current && turn.current) places.current = paintScene(element.current, { ...latest.current, turn: turn.current, every });
  };
  const drawMoving = (): void => {
    const { current } = waiting;
    clearTimeout(current.rest);
    current.rest = window.setTimeout(draw, kRest);
    if (current.frame !== 0) return;
    current.frame = requestAnimationFrame(() => {
      current.frame = 0;
      draw(Math.max(1, Math.ceil((world.pyramids.length * cameras.length) / kMostTurning)));
    });
  };
  const change = (by: (now: Turn) => Partial<Turn>): void => {
    if (!turn.current) return;
    turn.current = { ...turn.current, ...by(turn.current) };
    drawMoving();
  };

  useLayoutEffect(() => {
    const canvas = element.current;
    if (!canvas) return;
    const redraw = (): void => draw();
    const end = drawWhenNear(canvas, {
      title: "Target and camera poses",
      count: world.markers.length + world.pyramids.length * cameras.length,
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
      cancelAnimationFrame(waiting.current.frame);
    };
  }, []);
  useLayoutEffect(() => {
    turn.current = null;
  }, [world]);
  useLayoutEffect(() => draw(), [world, ghosts, displacements, magnify, rms, pose, hover, named]);

  return {
    view: (side) => {
      fit(side);
      draw();
    },
    rotate: (yaw, pitch) =>
      change((now) => ({ yaw: now.yaw + yaw, pitch: Math.min(Math.max(now.pitch + pitch, -Math.PI / 2), Math.PI / 2) })),
    move: (x, y) => {
      const canvas = element.current;
      const radius = canvas ? 0.5 * Math.min(canvas.clientWidth, canvas.clientHeight) : 1;
      change(({ shift }) => ({ shift: [shift[0] - x / radius, shift[1] - y / radius] }));
    },
    zoom: (factor) =>
      change(({ zoom, shift }) => ({
        zoom: Math.min(50, Math.max(0.1, zoom * factor)),
        shift: [shift[0] * factor, shift[1] * factor],
      })),
    nearest: (x, y) => {
      let best: Place | null = null;
      let least = kReach;
      for (const place of places.current) {
        const distance = Math.hypot(place.x - x, place.y - y);
        if (distance >= least) continue;
        best = place;
        least = distance;
      }
      return best;
    },
  };
}
