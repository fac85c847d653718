// SPDX-License-Identifier: Apache-2.0
// A marker's measurements in all its micro images, side by side.
import { useEffect, useRef } from "preact/hooks";
import type { Lenses, Point } from "../api/types";
import { seriesName } from "../plot/colours";
import { lensAt } from "./lenses";

const kTile = 96; // px on the screen

interface Shown {
  picture: HTMLImageElement;
  lenses: Lenses;
  lens: number;
  point: Point;
  factor: number;
}

function MicroImage({ picture, lenses, lens, point, factor }: Shown) {
  const element = useRef<HTMLCanvasElement>(null);
  const [cx, cy, type] = lenses.centres[lens] ?? [0, 0, 0];
  const [, x, y, dx, dy, used] = point;
  useEffect(() => {
    const canvas = element.current?.getContext("2d");
    if (!canvas) return;
    const style = getComputedStyle(document.documentElement);
    const scale = kTile / lenses.pitch;
    const left = cx + 0.5 - lenses.pitch / 2;
    const top = cy + 0.5 - lenses.pitch / 2;
    canvas.imageSmoothingEnabled = false;
    canvas.clearRect(0, 0, kTile, kTile);
    canvas.drawImage(picture, left, top, lenses.pitch, lenses.pitch, 0, 0, kTile, kTile);
    const a = scale * (x + 0.5 - left);
    const b = scale * (y + 0.5 - top);
    canvas.lineWidth = 1.5;
    canvas.strokeStyle = style.getPropertyValue(used ? "--good" : "--bad");
    canvas.strokeRect(a - 2.5, b - 2.5, 5, 5);
    if (dx === null || dy === null) return;
    canvas.strokeStyle = style.getPropertyValue(used ? "--arrow" : "--bad");
    canvas.beginPath();
    canvas.moveTo(a, b);
    canvas.lineTo(a + factor * scale * dx, b + factor * scale * dy);
    canvas.stroke();
  });
  const length = dx === null || dy === null ? "-" : Math.hypot(dx, dy).toFixed(2);
  return (
    <figure class="micro" style={`border-color: var(${seriesName(type)})`}>
      <canvas ref={element} width={kTile} height={kTile} role="img" aria-label={`micro image ${lens}`} />
      <figcaption>
        {length} px{used ? "" : ", rejected"}
      </figcaption>
    </figure>
  );
}

export function MicroImages({ picture, lenses, points, factor }: Omit<Shown, "lens" | "point"> & { points: Point[] }) {
  return (
    <div class="row micros">
      {points.map((point) => {
        const lens = lensAt(lenses, [point[1], point[2]]);
        return <MicroImage key={lens} picture={picture} lenses={lenses} lens={lens} point={point} factor={factor} />;
      })}
    </div>
  );
}
