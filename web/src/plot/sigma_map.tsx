// SPDX-License-Identifier: Apache-2.0
// Sigma of the projection over the image, on one absolute scale: 0.01 to 10 px, logarithmic.
import { useEffect, useRef } from "preact/hooks";
import type { SigmaMap } from "../api/types";

// Viridis at 0, 1/4, ... 1.
const kStops: [number, number, number][] = [
  [68, 1, 84],
  [59, 82, 139],
  [33, 145, 140],
  [94, 201, 98],
  [253, 231, 37],
];

export function colourOf(sigma: number): string {
  const part = Math.min(1, Math.max(0, (Math.log10(sigma) + 2) / 3)) * (kStops.length - 1);
  const i = Math.min(kStops.length - 2, Math.floor(part));
  const a = kStops[i] ?? [0, 0, 0];
  const b = kStops[i + 1] ?? a;
  const mix = a.map((value, k) => Math.round(value + (part - i) * ((b[k] ?? value) - value)));
  return `rgb(${mix.join(",")})`;
}

export function SigmaPicture({ map }: { map: SigmaMap }) {
  const element = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const canvas = element.current?.getContext("2d");
    if (!canvas || !element.current) return;
    element.current.width = map.columns;
    element.current.height = map.rows;
    map.sigma.forEach((sigma, cell) => {
      if (sigma === null) return;
      canvas.fillStyle = colourOf(sigma);
      canvas.fillRect(cell % map.columns, Math.floor(cell / map.columns), 1, 1);
    });
  }, [map]);
  const known = map.sigma.filter((sigma): sigma is number => sigma !== null);
  const worst = known.length ? Math.max(...known) : NaN;
  return (
    <figure class="map">
      <canvas ref={element} style={`aspect-ratio: ${map.columns} / ${map.rows}`} role="img" aria-label={`sigma at ${map.distance} m`} />
      <figcaption>
        {map.distance.toPrecision(3)} m: up to {worst.toPrecision(2)} px
      </figcaption>
    </figure>
  );
}
