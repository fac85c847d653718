// SPDX-License-Identifier: Apache-2.0
// Correlations of the unknowns, and what their errors do to a projection and to a measured distance.
import type { Accuracy, Report, ReportCamera } from "../api/calibration";
import { isKnown } from "../base/numbers";
import type { Painter } from "../plot/chart";
import { signed } from "../plot/colours";
import { ColourScale, Figure } from "../plot/figure";
import { PaintedChart } from "../plot/point_chart";
import { SigmaPicture } from "../plot/sigma_map";
import { AccuracyCharts } from "./accuracy";
import { Figures, Note } from "./page";

export function Correlations({ names, below_diagonal: rows }: Report["correlation"]) {
  if (rows.length < 2) return <Note>No correlations: there is no correlations.csv beside this calibration, or fewer than two unknowns.</Note>;
  const n = names.length;
  const value = (i: number, j: number): number => (i === j ? 1 : ((i > j ? rows[i]?.[j] : rows[j]?.[i]) ?? 0));
  const short = names.map((name) => name.replace("T_camera_rig.", ""));
  const axis = { label: "", names: short, range: [-0.5, n - 0.5] as [number, number] };
  const paint = ({ canvas, x, y }: Painter): void => {
    for (let i = 0; i < n; ++i) {
      const [top, bottom] = [Math.round(y(i - 0.5)), Math.round(y(i + 0.5))];
      for (let j = 0; j < n; ++j) {
        const left = Math.round(x(j - 0.5));
        canvas.fillStyle = signed(value(i, j));
        canvas.fillRect(left, top, Math.round(x(j + 0.5)) - left, bottom - top);
      }
    }
  };
  const title = "Correlation matrix";
  return (
    <div class="matrix">
      <Figure title={title} note="Two unknowns with a correlation near 1 or -1 cannot be determined separately by these images.">
        <PaintedChart
          name={title}
          count={n * n}
          aspect={1.1}
          x={{ ...axis, upright: true }}
          y={{ ...axis, reversed: true }}
          paint={paint}
          hover={{
            count: n * n,
            at: (k) => [k % n, Math.floor(k / n)],
            words: (k) => `${names[Math.floor(k / n)]}, ${names[k % n]}: ${value(Math.floor(k / n), k % n)}`,
            find: (x, y) => Math.round(y) * n + Math.round(x),
          }}
        />
        <ColourScale low="−1" high="1" colour={(part) => signed(2 * part - 1)} />
      </Figure>
    </div>
  );
}

const kDistances = ["Distance of the nearest marker", "Median distance of the markers", "Distance of the farthest marker", "Ten times the farthest marker"];

export function UncertaintyInUse({ cameras, accuracy }: { cameras: ReportCamera[]; accuracy: Accuracy[] }) {
  return (
    <>
      <AccuracyCharts accuracy={accuracy} />
      <Note>
        Standard deviation of the projection of a point, in its worst direction, caused by the errors of the parameters. Errors that a rotation
        and translation of the camera frame compensates are not counted. Colours are logarithmic and the same in all reports; empty: outside the
        domain of the model, or no point was seen.
      </Note>
      {cameras.map((camera) => (
        <div key={camera.name}>
          <h3>{camera.name}</h3>
          {camera.projection.length === 0 ? (
            <Note>Not known: some parameter is not determined, or there is no correlations.csv beside this calibration.</Note>
          ) : (
            <Figures small>
              {camera.projection.map(
                (map, i) =>
                  map.sigma.some(isKnown) && <SigmaPicture key={i} map={map} size={camera.image_size} note={`${kDistances[i] ?? ""}.`} />,
              )}
            </Figures>
          )}
        </div>
      ))}
    </>
  );
}
