// SPDX-License-Identifier: Apache-2.0
// An image with its points and residuals; wheel and buttons zoom, a drag moves.
import { useEffect, useRef, useState } from "preact/hooks";
import { imagePath } from "../api/client";
import type { Point } from "../api/types";
import { usePicture } from "../parts/picture";

interface Looks {
  camera: string;
  frame: string;
  size: [number, number];
  points: Point[];
  /** Length of a residual on the screen over that in the image. */
  factor: number;
  excluded: boolean;
  outlines?: [number, number][][];
}

interface Part {
  x: number;
  y: number;
  scale: number;
}

const colour = (name: string): string => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function arrow(canvas: CanvasRenderingContext2D, x: number, y: number, dx: number, dy: number): void {
  canvas.beginPath();
  canvas.moveTo(x, y);
  canvas.lineTo(x + dx, y + dy);
  const angle = Math.atan2(dy, dx);
  const head = Math.min(6, 0.4 * Math.hypot(dx, dy));
  for (const side of [-0.5, 0.5]) {
    canvas.moveTo(x + dx, y + dy);
    canvas.lineTo(x + dx - head * Math.cos(angle + side), y + dy - head * Math.sin(angle + side));
  }
  canvas.stroke();
}

function draw(element: HTMLCanvasElement, image: HTMLImageElement | null, looks: Looks, part: Part): void {
  const canvas = element.getContext("2d");
  if (!canvas) return;
  const dots = window.devicePixelRatio || 1;
  element.width = Math.round(element.clientWidth * dots);
  element.height = Math.round(element.clientHeight * dots);
  canvas.setTransform(dots, 0, 0, dots, 0, 0);
  canvas.clearRect(0, 0, element.clientWidth, element.clientHeight);
  const { x, y, scale } = part;
  const at = (u: number, v: number): [number, number] => [x + scale * (u + 0.5), y + scale * (v + 0.5)];
  canvas.imageSmoothingEnabled = scale < 4;
  if (image) canvas.drawImage(image, x, y, scale * looks.size[0], scale * looks.size[1]);
  canvas.lineWidth = 1.5;
  for (const [, u, v, dx, dy, used] of looks.points) {
    const [a, b] = at(u, v);
    canvas.strokeStyle = used ? colour("--good") : colour("--bad");
    if (!used) {
      canvas.beginPath();
      canvas.moveTo(a - 4, b - 4);
      canvas.lineTo(a + 4, b + 4);
      canvas.moveTo(a + 4, b - 4);
      canvas.lineTo(a - 4, b + 4);
      canvas.stroke();
    } else {
      canvas.strokeRect(a - 1.5, b - 1.5, 3, 3);
    }
    if (dx === null || dy === null) continue;
    canvas.strokeStyle = used ? colour("--arrow") : colour("--bad");
    arrow(canvas, a, b, looks.factor * scale * dx, looks.factor * scale * dy);
  }
  canvas.strokeStyle = colour("--accent");
  canvas.lineWidth = 2;
  for (const outline of looks.outlines ?? []) {
    canvas.beginPath();
    outline.forEach(([u, v], i) => (i === 0 ? canvas.moveTo(...at(u, v)) : canvas.lineTo(...at(u, v))));
    canvas.closePath();
    canvas.fillStyle = "rgb(255 255 255 / 35%)";
    canvas.fill();
    canvas.stroke();
  }
  if (looks.excluded) {
    canvas.strokeStyle = colour("--bad");
    canvas.lineWidth = 1;
    canvas.beginPath();
    for (let k = -element.clientHeight; k < element.clientWidth; k += 24) {
      canvas.moveTo(k, element.clientHeight);
      canvas.lineTo(k + element.clientHeight, 0);
    }
    canvas.stroke();
  }
}

export function Plane(looks: Looks) {
  const element = useRef<HTMLCanvasElement>(null);
  const [image, setImage] = useState<HTMLImageElement | null>(null);
  const [part, setPart] = useState<Part | null>(null);
  const [width, setWidth] = useState(0);
  const url = usePicture(imagePath(looks.camera, looks.frame, 0), true);
  useEffect(() => {
    setImage(null);
    if (!url) return;
    const made = new Image();
    made.onload = () => setImage(made);
    made.src = url;
  }, [url]);
  useEffect(() => {
    if (!element.current) return;
    const watch = new ResizeObserver(() => setWidth(element.current?.clientWidth ?? 0));
    watch.observe(element.current);
    return () => watch.disconnect();
  }, []);
  const whole: Part = { x: 0, y: 0, scale: (width || 1) / looks.size[0] };
  const shown = part ?? whole;
  useEffect(() => {
    if (element.current && width > 0) draw(element.current, image, looks, shown);
  });
  const zoom = (factor: number, x: number, y: number): void => {
    const scale = Math.min(40, Math.max(whole.scale, shown.scale * factor));
    if (scale === whole.scale) return setPart(null);
    const grow = scale / shown.scale;
    setPart({ scale, x: x - grow * (x - shown.x), y: y - grow * (y - shown.y) });
  };
  const middle = (factor: number): void =>
    zoom(factor, width / 2, (element.current?.clientHeight ?? 0) / 2);
  return (
    <div class="plane">
      <canvas
        ref={element}
        style={`aspect-ratio: ${looks.size[0]} / ${looks.size[1]}`}
        aria-label={`${looks.camera} ${looks.frame} with ${looks.points.length} points`}
        role="img"
        data-points={looks.points.length}
        data-loaded={image ? "yes" : "no"}
        onWheel={(event) => {
          event.preventDefault();
          zoom(Math.exp(-event.deltaY / 300), event.offsetX, event.offsetY);
        }}
        onPointerMove={(event) => {
          if (event.buttons !== 1 || !part) return;
          setPart({ ...part, x: part.x + event.movementX, y: part.y + event.movementY });
        }}
      />
      <div class="tools">
        <button onClick={() => middle(1.5)} aria-label="zoom in">+</button>
        <button onClick={() => middle(1 / 1.5)} aria-label="zoom out">−</button>
        <button onClick={() => setPart(null)}>fit</button>
      </div>
    </div>
  );
}
