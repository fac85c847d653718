// SPDX-License-Identifier: Apache-2.0
// Fields over an image: cells in colours, arrows.
import type { Field as Means } from "../api/calibration";
import { brief, isKnown, rangeOf } from "../base/numbers";
import { arrow } from "./arrow";
import type { Axis } from "./axes";
import type { Painter } from "./chart";
import { ramp, styled } from "./colours";
import type { Caption } from "./figure";
import { ColourScale, Figure } from "./figure";
import { PaintedChart } from "./point_chart";

export type Size = readonly [number, number];

const pixelAxis = (label: string, size: number): Axis & { range: [number, number] } => ({
  label,
  range: [-0.5, size - 0.5],
  text: (value) => String(Math.round(value)),
});
export const imageAxes = ([width, height]: Size) => ({
  x: pixelAxis("x, px", width),
  y: { ...pixelAxis("y, px", height), reversed: true },
});
export const imageAspect = ([width, height]: Size): number => Math.min(Math.max(width / height, 0.7), 2.2);

/** A grid of cells over an image. */
export interface Grid {
  columns: number;
  rows: number;
}

function cellAt({ columns, rows }: Grid, [width, height]: Size, x: number, y: number): number {
  const column = Math.floor(((x + 0.5) * columns) / width);
  const row = Math.floor(((y + 0.5) * rows) / height);
  return column < 0 || row < 0 || column >= columns || row >= rows ? -1 : row * columns + column;
}

function middleOf({ columns, rows }: Grid, [width, height]: Size, cell: number): [number, number] {
  return [(((cell % columns) + 0.5) * width) / columns - 0.5, ((Math.floor(cell / columns) + 0.5) * height) / rows - 0.5];
}

function paintCells(painter: Painter, grid: Grid, size: Size, colour: (cell: number) => string | null): void {
  const { canvas, x, y } = painter;
  const lefts = Array.from({ length: grid.columns + 1 }, (_, i) => Math.round(x((i * size[0]) / grid.columns - 0.5)));
  const tops = Array.from({ length: grid.rows + 1 }, (_, i) => Math.round(y((i * size[1]) / grid.rows - 0.5)));
  for (let cell = 0; cell < grid.columns * grid.rows; ++cell) {
    const fill = colour(cell);
    if (fill === null) continue;
    const column = cell % grid.columns;
    const row = Math.floor(cell / grid.columns);
    const [left = 0, right = 0] = lefts.slice(column);
    const [top = 0, bottom = 0] = tops.slice(row);
    canvas.fillStyle = fill;
    canvas.fillRect(left, top, right - left, bottom - top);
  }
}

/** Those cells that `isThere`, to be named. */
function cellHover(grid: Grid, size: Size, isThere: (cell: number) => boolean, words: (cell: number) => string) {
  const cells = Array.from({ length: grid.columns * grid.rows }, (_, cell) => cell).filter(isThere);
  return {
    count: cells.length,
    at: (i: number) => middleOf(grid, size, cells[i] ?? 0),
    words: (i: number) => words(cells[i] ?? 0),
    find: (x: number, y: number) => cells.indexOf(cellAt(grid, size, x, y)),
  };
}

interface Cells extends Caption {
  size: Size;
  grid: Grid;
  values: readonly (number | null)[];
  unit: string;
  /** What the ends of the colours mean. */
  range?: [number, number];
  logarithmic?: boolean;
}

export function CellMap({ size, grid, values, unit, range, logarithmic, ...caption }: Cells) {
  const [low, high] = range ?? rangeOf(values);
  const height = logarithmic ? Math.log : (value: number) => value;
  const part = (value: number): number => (height(value) - height(low)) / (height(high) - height(low) || 1);
  const hover = cellHover(grid, size, (cell) => isKnown(values[cell]), (cell) => `${brief(values[cell])} ${unit}`);
  return (
    <Figure {...caption}>
      <PaintedChart
        name={caption.title}
        count={hover.count}
        aspect={imageAspect(size)}
        {...imageAxes(size)}
        paint={(painter) =>
          paintCells(painter, grid, size, (cell) => {
            const value = values[cell];
            return isKnown(value) ? ramp(part(value)) : null;
          })
        }
        hover={hover}
      />
      <ColourScale low={`${brief(low)} ${unit}`} high={`${brief(high)} ${unit}`} />
    </Figure>
  );
}

/** Mean vectors of the cells of an image. */
export type Field = Omit<Means, "rms">;

/** Length of an arrow that is drawn a cell and a half long: 95 of 100 are shorter, and none is longer than four cells. */
export function typicalArrow({ mean_x, mean_y }: Field): number {
  const lengths = mean_x
    .map((x, cell) => (x === null ? null : Math.hypot(x, mean_y[cell] ?? 0)))
    .filter(isKnown)
    .sort((a, b) => a - b);
  return Math.max(lengths[Math.floor(0.95 * (lengths.length - 1))] ?? 0, (1.5 / 4) * (lengths.at(-1) ?? 0));
}

const tint = (part: number): string => ramp(part, 0.45);

interface Arrows extends Caption {
  size: Size;
  field: Field;
  /** Colours of the cells. */
  values?: readonly (number | null)[];
  /** Several maps have one scale. */
  scale?: { arrow: number; low: number; high: number };
}

export function ArrowMap({ size, field, values, scale, note = "", ...caption }: Arrows) {
  const { mean_x, mean_y } = field;
  const magnify = (1.5 * size[0]) / field.columns / ((scale?.arrow ?? typicalArrow(field)) || 1);
  const low = scale?.low ?? 0;
  const high = scale?.high ?? (values ? rangeOf(values)[1] || 1 : 1);
  const vector = (cell: number): [number, number] => [mean_x[cell] ?? 0, mean_y[cell] ?? 0];
  const hover = cellHover(
    field,
    size,
    (cell) => isKnown(mean_x[cell]),
    (cell) => {
      const rms = values ? `; RMS ${brief(values[cell])} px` : "";
      return `mean (${vector(cell).map((v) => brief(v)).join(", ")}) px${rms}; ${field.points[cell]} points`;
    },
  );
  const paint = (painter: Painter): void => {
    const { canvas, x, y, unit } = painter;
    if (values) {
      paintCells(painter, field, size, (cell) => {
        const value = values[cell];
        return isKnown(value) ? tint((value - low) / (high - low)) : null;
      });
    }
    canvas.strokeStyle = styled("--text");
    canvas.lineWidth = 1.3 * unit;
    for (let i = 0; i < hover.count; ++i) {
      const [u, v] = hover.at(i);
      const [dx, dy] = vector(cellAt(field, size, u, v));
      arrow(canvas, x(u), y(v), x(u + magnify * dx) - x(u), y(v + magnify * dy) - y(v), unit);
    }
  };
  return (
    <Figure {...caption} note={`${note} Arrows are ${brief(magnify, 2)} times as long as what they stand for.`}>
      <PaintedChart name={caption.title} count={hover.count} aspect={imageAspect(size)} {...imageAxes(size)} paint={paint} hover={hover} />
      {values && <ColourScale low={`RMS ${brief(low)} px`} high={`${brief(high)} px`} colour={tint} />}
    </Figure>
  );
}
