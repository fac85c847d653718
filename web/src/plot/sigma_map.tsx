// SPDX-License-Identifier: Apache-2.0
// Sigma of the projection over the image, on one absolute scale: 0.01 to 10 px, logarithmic.
import { useEffect, useRef } from "preact/hooks";
import type { SigmaMap } from "../api/types";
import { viridis } from "./viridis";

const colourOf = (sigma: number): string => `rgb(${viridis((Math.log10(sigma) + 2) / 3).join(",")})`;

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
