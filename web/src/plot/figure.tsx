// SPDX-License-Identifier: Apache-2.0
// A drawing with its caption, and what its colours mean.
import type { ComponentChildren } from "preact";
import { ramp } from "./colours";

export interface Caption {
  title: string;
  note?: string;
  /** Takes two columns of the grid, or all. */
  breadth?: "broad" | "wide" | undefined;
}

export function Figure({ title, note, breadth, children }: Caption & { children: ComponentChildren }) {
  return (
    <figure class={breadth ?? ""}>
      <figcaption>
        {title}
        {note && <small>{note}</small>}
      </figcaption>
      {children}
    </figure>
  );
}

/** A strip of the colours from `low` to `high`. */
export function ColourScale({ low, high, colour = ramp }: { low: string; high: string; colour?: (part: number) => string }) {
  const stops = Array.from({ length: 11 }, (_, i) => colour(i / 10)).join(", ");
  return (
    <div class="scale">
      {low}
      <i style={`background: linear-gradient(90deg, ${stops})`} />
      {high}
    </div>
  );
}

export interface Key {
  label: string;
  /** A variable of the style sheet. */
  colour: string;
}

export function Keys({ keys }: { keys: Key[] }) {
  if (keys.length < 2) return null;
  return (
    <p class="keys">
      {keys.map(({ label, colour }) => (
        <span key={label}>
          <i style={`background: var(${colour})`} /> {label}
        </span>
      ))}
    </p>
  );
}
