// SPDX-License-Identifier: Apache-2.0
// Points anywhere, painted on the chart: thousands are as quick as ten.
import type { ComponentChildren } from "preact";
import { useMemo } from "preact/hooks";
import type { Axis } from "./axes";
import { Chart } from "./chart";
import type { Hover, Painter } from "./chart";
import { styled } from "./colours";
import type { Caption } from "./figure";
import { Figure, Keys } from "./figure";

export interface PointGroup {
  label: string;
  /** A variable of the style sheet. */
  colour: string;
  points: readonly (readonly [number, number])[];
  /** px. */
  radius: number;
  line?: boolean;
  /** Of each point in place of `colour`. */
  tint?: (i: number) => string;
}

function paintGroup({ canvas, x, y, unit }: Painter, { points, radius, colour, line, tint }: PointGroup): void {
  const size = 2 * radius * unit;
  canvas.fillStyle = canvas.strokeStyle = styled(colour);
  points.forEach(([u, v], i) => {
    if (tint) canvas.fillStyle = tint(i);
    canvas.fillRect(x(u) - size / 2, y(v) - size / 2, size, size);
  });
  if (!line) return;
  canvas.lineWidth = 1.5 * unit;
  canvas.beginPath();
  points.forEach(([u, v], i) => (i === 0 ? canvas.moveTo(x(u), y(v)) : canvas.lineTo(x(u), y(v))));
  canvas.stroke();
}

/** Chart of nothing but what `paint` puts between the ends of its axes. */
export function PaintedChart(look: {
  name: string;
  count: number;
  aspect: number;
  x: Axis & { range: [number, number] };
  y: Axis & { range: [number, number] };
  paint: (painter: Painter) => void;
  hover: Hover;
}) {
  // Axes need a datum.
  const data = useMemo<[number[], number[]]>(() => [look.x.range, look.y.range], []);
  return <Chart {...look} data={data} series={[{ paths: () => null, points: { show: false } }]} />;
}

interface Points extends Caption {
  groups: PointGroup[];
  x: Axis & { range: [number, number] };
  y: Axis & { range: [number, number] };
  words: (group: number, i: number) => string;
  aspect: number;
  children?: ComponentChildren;
}

export function PointChart({ groups, x, y, words, aspect, children, ...caption }: Points) {
  const order = useMemo(() => groups.flatMap(({ points }, group) => points.map((_, i) => [group, i] as const)), []);
  return (
    <Figure {...caption}>
      <PaintedChart
        name={caption.title}
        count={order.length}
        aspect={aspect}
        x={x}
        y={y}
        paint={(painter) => groups.forEach((group) => paintGroup(painter, group))}
        hover={{
          count: order.length,
          at: (k) => {
            const [group, i] = order[k] ?? [0, 0];
            const [u, v] = groups[group]?.points[i] ?? [0, 0];
            return [u, v];
          },
          words: (k) => words(...(order[k] ?? [0, 0])),
        }}
      />
      {children}
      <Keys keys={groups} />
    </Figure>
  );
}
