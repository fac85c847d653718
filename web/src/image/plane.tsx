// SPDX-License-Identifier: Apache-2.0
// An image with its points and residuals; wheel and buttons zoom, a drag moves.
import { useEffect, useRef, useState } from "preact/hooks";
import type { Lenses, Point } from "../api/types";
import { arrow } from "../plot/arrow";
import { seriesName, styled } from "../plot/colours";
import { markersAt, markersInside } from "./choose";
import type { Pixel } from "./choose";

interface Looks {
  /** For readers that do not see it. */
  name: string;
  picture: CanvasImageSource | null;
  /** Of the image in its own pixels; a smaller picture is drawn as large. */
  size: [number, number];
  points?: Point[];
  /** Length of a residual on the screen over that in the image. */
  factor?: number;
  /** The whole image, and single markers. */
  excluded?: boolean;
  excludedMarkers?: number[];
  outlines?: Pixel[][];
  lenses?: Lenses | null;
  /** Places that go with the pointer in another image. */
  marks?: Pixel[];
  chosen?: number[];
  /** A click chooses the point beside it, a line with Shift or the tool all points inside. */
  onChoose?: (markers: number[]) => void;
  /** Where the pointer is; null when it has left. */
  onPointer?: (at: Pixel | null) => void;
}

interface Part {
  x: number;
  y: number;
  scale: number;
}

function cross(canvas: CanvasRenderingContext2D, x: number, y: number, half: number): void {
  canvas.beginPath();
  canvas.moveTo(x - half, y - half);
  canvas.lineTo(x + half, y + half);
  canvas.moveTo(x + half, y - half);
  canvas.lineTo(x - half, y + half);
  canvas.stroke();
}

// Below this size on the screen the circles would hide the image.
const kSmallestLens = 24; // px

function drawLenses(canvas: CanvasRenderingContext2D, lenses: Lenses, part: Part): void {
  const radius = (lenses.pitch / 2) * part.scale;
  if (2 * radius < kSmallestLens) return;
  canvas.lineWidth = 1;
  for (const [x, y, type] of lenses.centres) {
    canvas.strokeStyle = styled(seriesName(type));
    canvas.beginPath();
    canvas.arc(part.x + part.scale * (x + 0.5), part.y + part.scale * (y + 0.5), radius, 0, 2 * Math.PI);
    canvas.stroke();
  }
}

function draw(element: HTMLCanvasElement, looks: Looks, part: Part, lasso: Pixel[]): void {
  const canvas = element.getContext("2d");
  if (!canvas) return;
  const dots = window.devicePixelRatio || 1;
  element.width = Math.round(element.clientWidth * dots);
  element.height = Math.round(element.clientHeight * dots);
  canvas.setTransform(dots, 0, 0, dots, 0, 0);
  canvas.clearRect(0, 0, element.clientWidth, element.clientHeight);
  const { x, y, scale } = part;
  const at = (u: number, v: number): Pixel => [x + scale * (u + 0.5), y + scale * (v + 0.5)];
  canvas.imageSmoothingEnabled = scale < 4;
  if (looks.picture) canvas.drawImage(looks.picture, x, y, scale * looks.size[0], scale * looks.size[1]);
  if (looks.lenses) drawLenses(canvas, looks.lenses, part);
  canvas.lineWidth = 1.5;
  const chosen = new Set(looks.chosen);
  const excluded = new Set(looks.excludedMarkers);
  for (const [marker, u, v, dx, dy, used] of looks.points ?? []) {
    const [a, b] = at(u, v);
    const counts = used && !excluded.has(marker);
    canvas.strokeStyle = counts ? styled("--good") : styled("--bad");
    if (counts) canvas.strokeRect(a - 1.5, b - 1.5, 3, 3);
    else cross(canvas, a, b, 4);
    if (chosen.has(marker)) {
      canvas.strokeStyle = styled("--accent");
      canvas.beginPath();
      canvas.arc(a, b, 7, 0, 2 * Math.PI);
      canvas.stroke();
    }
    if (dx === null || dy === null) continue;
    canvas.strokeStyle = counts ? styled("--arrow") : styled("--bad");
    arrow(canvas, a, b, (looks.factor ?? 1) * scale * dx, (looks.factor ?? 1) * scale * dy);
  }
  canvas.strokeStyle = styled("--accent");
  canvas.lineWidth = 2;
  // Those of neighbouring micro images keep apart.
  const half = looks.lenses ? Math.min(6, 0.25 * scale * looks.lenses.pitch) : 6;
  for (const mark of looks.marks ?? []) cross(canvas, ...at(...mark), half);
  for (const outline of [...(looks.outlines ?? []), lasso]) {
    canvas.beginPath();
    outline.forEach(([u, v], i) => (i === 0 ? canvas.moveTo(...at(u, v)) : canvas.lineTo(...at(u, v))));
    canvas.closePath();
    canvas.fillStyle = "rgb(255 255 255 / 35%)";
    canvas.fill();
    canvas.stroke();
  }
  if (looks.excluded) {
    canvas.strokeStyle = styled("--bad");
    canvas.lineWidth = 1;
    canvas.beginPath();
    for (let k = -element.clientHeight; k < element.clientWidth; k += 24) {
      canvas.moveTo(k, element.clientHeight);
      canvas.lineTo(k + element.clientHeight, 0);
    }
    canvas.stroke();
  }
}

// Within this distance on the screen a click chooses a point, and is no drag.
const kReach = 10;

export function Plane(looks: Looks) {
  const element = useRef<HTMLCanvasElement>(null);
  const [part, setPart] = useState<Part | null>(null);
  const [width, setWidth] = useState(0);
  const [lassoing, setLassoing] = useState(false);
  const [lasso, setLasso] = useState<Pixel[]>([]);
  // Of the pressed pointer: the way on the screen, and the line that it draws.
  const drag = useRef<{ way: number; line: Pixel[] }>({ way: 0, line: [] });
  const points = looks.points ?? [];
  useEffect(() => {
    if (!element.current) return;
    const watch = new ResizeObserver(() => setWidth(element.current?.clientWidth ?? 0));
    watch.observe(element.current);
    return () => watch.disconnect();
  }, []);
  const whole: Part = { x: 0, y: 0, scale: (width || 1) / looks.size[0] };
  const shown = part ?? whole;
  useEffect(() => {
    if (element.current && width > 0) draw(element.current, looks, shown, lasso);
  });
  const zoom = (factor: number, x: number, y: number): void => {
    const scale = Math.min(40, Math.max(whole.scale, shown.scale * factor));
    if (scale === whole.scale) return setPart(null);
    const grow = scale / shown.scale;
    setPart({ scale, x: x - grow * (x - shown.x), y: y - grow * (y - shown.y) });
  };
  const middle = (factor: number): void =>
    zoom(factor, width / 2, (element.current?.clientHeight ?? 0) / 2);
  const pixelOf = (event: PointerEvent): Pixel => [
    (event.offsetX - shown.x) / shown.scale - 0.5,
    (event.offsetY - shown.y) / shown.scale - 0.5,
  ];
  const down = (event: PointerEvent): void => {
    const draws = looks.onChoose && event.button === 0 && (lassoing || event.shiftKey);
    drag.current = { way: 0, line: draws ? [pixelOf(event)] : [] };
    if (draws) element.current?.setPointerCapture(event.pointerId);
  };
  const move = (event: PointerEvent): void => {
    looks.onPointer?.(pixelOf(event));
    if (event.buttons !== 1) return;
    const { line } = drag.current;
    drag.current.way += Math.hypot(event.movementX, event.movementY);
    if (line.length > 0) {
      line.push(pixelOf(event));
      setLasso([...line]);
    } else if (part) {
      setPart({ ...part, x: part.x + event.movementX, y: part.y + event.movementY });
    }
  };
  const up = (event: PointerEvent): void => {
    const { way, line } = drag.current;
    drag.current.line = [];
    setLasso([]);
    if (!looks.onChoose || event.button !== 0) return;
    if (way < kReach) looks.onChoose(markersAt(points, pixelOf(event), kReach / shown.scale));
    else if (line.length > 0) looks.onChoose(markersInside(points, line));
  };
  return (
    <div class="plane">
      <canvas
        ref={element}
        style={`aspect-ratio: ${looks.size[0]} / ${looks.size[1]}${lassoing ? "; touch-action: none" : ""}`}
        aria-label={`${looks.name} with ${points.length} points`}
        role="img"
        data-points={points.length}
        data-loaded={looks.picture ? "yes" : "no"}
        data-marks={looks.marks?.map(([u, v]) => `${u.toFixed(1)},${v.toFixed(1)}`).join(" ") ?? ""}
        onWheel={(event) => {
          event.preventDefault();
          zoom(Math.exp(-event.deltaY / 300), event.offsetX, event.offsetY);
        }}
        onPointerDown={down}
        onPointerMove={move}
        onPointerUp={up}
        onPointerCancel={() => setLasso([])}
        onPointerLeave={() => looks.onPointer?.(null)}
      />
      <div class="tools">
        {looks.onChoose && (
          <button aria-pressed={lassoing} title="draw a line around points (or drag with Shift)" onClick={() => setLassoing(!lassoing)}>
            lasso
          </button>
        )}
        <button onClick={() => middle(1.5)} aria-label="zoom in">+</button>
        <button onClick={() => middle(1 / 1.5)} aria-label="zoom out">−</button>
        <button onClick={() => setPart(null)}>fit</button>
      </div>
    </div>
  );
}
