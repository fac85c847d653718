// SPDX-License-Identifier: Apache-2.0
// Refined positions of the markers against the nominal ones.
import type { Report } from "../api/calibration";
import { brief, rangeOf, roundUp } from "../base/numbers";
import { arrow } from "../plot/arrow";
import type { Painter } from "../plot/chart";
import { ramp } from "../plot/colours";
import { ColourScale, Figure } from "../plot/figure";
import { PaintedChart } from "../plot/point_chart";
import type { Vector } from "../space/geometry";
import { Figures, Note } from "./page";

/** All lengths in mm. */
interface Moved {
  number: number;
  place: Vector;
  by: Vector;
  sigma: Vector;
}
type Direction = 0 | 1 | 2;
const kNames = ["x", "y", "z"] as const;
const millimetres = (v: Vector): Vector => [1e3 * v[0], 1e3 * v[1], 1e3 * v[2]];
const signedRamp = (part: number): string => ramp(0.85 * part);

/** Two coordinates of the markers; the third is the colour. */
function Displacements({ moved, a, b, rms, broad }: { moved: Moved[]; a: Direction; b: Direction; rms: number; broad: boolean }) {
  const c = (3 - a - b) as Direction;
  const spans = [a, b].map((k) => rangeOf(moved.map(({ place }) => place[k]))).map(([low, high]) => high - low);
  const magnify = (0.08 * Math.max(...spans)) / (rms || 1);
  const most = Math.max(...rangeOf(moved.map(({ by }) => by[c])).map(Math.abs)) || 1;
  // The range includes the tips of the arrows.
  const ends = (k: Direction): [number, number] => {
    const [low, high] = rangeOf(moved.flatMap(({ place, by }) => [place[k], place[k] + magnify * by[k]]));
    const step = roundUp((high - low) / 20 || 1);
    return [step * Math.floor(low / step - 0.2), step * Math.ceil(high / step + 0.2)];
  };
  const x = { label: `${kNames[a]}, mm`, range: ends(a) };
  const y = { label: `${kNames[b]}, mm`, range: ends(b) };
  const paint = (painter: Painter): void => {
    painter.canvas.lineWidth = 1.3 * painter.unit;
    for (const { place, by } of moved) {
      painter.canvas.strokeStyle = signedRamp((by[c] / most + 1) / 2);
      const [u, v] = [painter.x(place[a]), painter.y(place[b])];
      arrow(painter.canvas, u, v, painter.x(place[a] + magnify * by[a]) - u, painter.y(place[b] + magnify * by[b]) - v, painter.unit);
    }
  };
  const vector = (v: Vector, digits: number): string => v.map((each) => brief(each, digits)).join(", ");
  const title = `From nominal to refined, ${kNames[a]} and ${kNames[b]}`;
  return (
    <Figure
      title={title}
      note={`Arrows are ${brief(magnify, 2)} times as long as the displacement; colour: along ${kNames[c]}.`}
      breadth={broad ? "broad" : undefined}
    >
      <PaintedChart
        name={title}
        count={moved.length}
        aspect={Math.min(Math.max((x.range[1] - x.range[0]) / (y.range[1] - y.range[0]), 0.8), 2.2)}
        x={x}
        y={y}
        paint={paint}
        hover={{
          count: moved.length,
          at: (i) => [moved[i]?.place[a] ?? 0, moved[i]?.place[b] ?? 0],
          words: (i) => {
            const marker = moved[i];
            return marker ? `marker ${marker.number}: (${vector(marker.by, 3)}) mm, sigma (${vector(marker.sigma, 2)})` : "";
          },
        }}
      />
      <ColourScale low={`${kNames[c]}: ${brief(-most)} mm`} high={`${brief(most)} mm`} colour={signedRamp} />
    </Figure>
  );
}

export function Markers({ report }: { report: Report }) {
  const moved = report.markers.flatMap(({ number, place, moved: by, sigma }): Moved[] =>
    by && sigma ? [{ number, place: millimetres(place), by: millimetres(by), sigma: millimetres(sigma) }] : [],
  );
  if (moved.length === 0) {
    return (
      <Note>
        {report.scene ? "The points are of the scene: they have no nominal positions." : "The markers were fixed at their nominal positions."}
      </Note>
    );
  }
  const length = ({ by }: Moved): number => Math.hypot(...by);
  const rms = Math.sqrt(moved.reduce((sum, marker) => sum + length(marker) ** 2, 0) / moved.length);
  const worst = moved.reduce((a, b) => (length(b) > length(a) ? b : a));
  const spans = ([0, 1, 2] as const).map((k) => rangeOf(moved.map(({ place }) => place[k]))).map(([low, high]) => high - low);
  // Two coordinates show a flat target; one in space needs a second view.
  const pairs: [Direction, Direction][] = [[0, 1], [0, 2], [1, 2]];
  const views = pairs.filter((pair) => Math.min(...pair.map((k) => spans[k] ?? 0)) > 0.02 * Math.max(...spans));
  return (
    <>
      <Note>
        The refined markers are {brief(rms)} mm RMS from their nominal positions (tolerance {brief(1e3 * (report.marker_tolerance ?? 0))} mm per
        coordinate), at most {brief(length(worst))} mm (marker {worst.number}).
      </Note>
      <Figures>
        {views.map(([a, b]) => (
          <Displacements key={`${a}${b}`} moved={moved} a={a} b={b} rms={rms} broad={views.length === 1} />
        ))}
      </Figures>
    </>
  );
}
