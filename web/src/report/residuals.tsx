// SPDX-License-Identifier: Apache-2.0
// Residuals and coverage of one camera.
import type { Pose, ReportCamera, Sample, Sums } from "../api/calibration";
import { brief, counted, rangeOf, roundUp } from "../base/numbers";
import { BarChart } from "../plot/bar_chart";
import { ramp } from "../plot/colours";
import { ColourScale, Figure } from "../plot/figure";
import { FrameBars } from "../plot/frame_bars";
import { ArrowMap, CellMap, imageAspect, imageAxes } from "../plot/image_field";
import { PointChart } from "../plot/point_chart";
import { Figures, Note } from "./page";

type Frames = Pose[];

const everyKth = ({ step, all }: Sample): string => (step > 1 ? `Every ${step}th of ${all} points.` : "");

const pointName = ({ frame, marker }: Sample, frames: Frames, i: number): string =>
  `frame ${frames[frame[i] ?? -1]?.name}, marker ${marker[i]}`;

function ResidualPoints({ sample, frames }: { sample: Sample; frames: Frames }) {
  const indices = sample.x.map((_, i) => i);
  const groups = [indices.filter((i) => sample.used[i] === 1), indices.filter((i) => sample.used[i] === 0)];
  const [used = [], rejected = []] = groups;
  const at = (i: number): [number, number] => [sample.dx[i] ?? 0, sample.dy[i] ?? 0];
  const reach = roundUp(1.05 * Math.max(0, ...rangeOf(used.flatMap(at)).map(Math.abs).filter(Number.isFinite)) || 1);
  const beyond = rejected.filter((i) => at(i).some((v) => Math.abs(v) > reach)).length;
  const axis = (label: string, reversed: boolean) => ({ label, range: [-reach, reach] as [number, number], reversed });
  return (
    <PointChart
      title="Residuals"
      note={`Measured minus predicted.${beyond ? ` ${counted(beyond, "rejected point")} outside.` : ""}`}
      aspect={1.2}
      x={axis("dx, px", false)}
      y={axis("dy, px", true)}
      groups={[
        { label: "used", colour: "--faint", radius: 1.5, points: used.map(at) },
        { label: "rejected", colour: "--bad", radius: 2.5, points: rejected.map(at) },
      ]}
      words={(group, k) => {
        const i = groups[group]?.[k] ?? 0;
        return `${pointName(sample, frames, i)}: (${at(i).map((v) => brief(v)).join(", ")}) px`;
      }}
    />
  );
}

function GroupBars({ title, names, sums, unit }: { title: string; names: string[]; sums: Sums; unit: string }) {
  const breadth = names.length > 150 ? "wide" : names.length > 40 ? "broad" : undefined;
  const bars = names.map((name, i) => ({
    name,
    size: sums.rms[i] ?? null,
    words: `${brief(sums.rms[i])} px, ${sums.points[i]} points, ${sums.rejected[i]} rejected`,
  }));
  return (
    <Figure title={title} note="RMS reprojection error." breadth={breadth}>
      <FrameBars name={title} bars={bars} x={unit} y="RMS, px" aspect={breadth === "wide" ? 3.5 : breadth === "broad" ? 2.5 : 1.2} />
    </Figure>
  );
}

function Histogram({ sigmas, counts, expected, noise_left, outside, coordinates }: ReportCamera["plots"]["histogram"]) {
  const absorbed = noise_left < 0.9 ? ` The estimated parameters absorb ${Math.round(100 * (1 - noise_left))} % of the noise.` : "";
  return (
    <BarChart
      title="Histogram of both coordinates"
      note={`Residuals divided by their noise sigma, with the normal distribution.${absorbed}${outside ? ` ${outside} of ${coordinates} outside.` : ""}`}
      names={sigmas.map(String)}
      middles={sigmas}
      x="residual / sigma"
      y={{ label: "coordinates" }}
      series={[
        { label: "residuals", values: counts, colour: "--faint" },
        { label: "normal", values: expected, colour: "--series-1", line: true },
      ]}
    />
  );
}

export function Residuals({ camera, frames }: { camera: ReportCamera; frames: Frames }) {
  const { sample, field, histogram, frames: byFrame, markers, types } = camera.plots;
  return (
    <>
      <h3>{camera.name}</h3>
      {sample.step > 1 && (
        <Note>
          Plots of single points show every {sample.step}th of {sample.all} points; all other plots use every point.
        </Note>
      )}
      <Figures>
        <ResidualPoints sample={sample} frames={frames} />
        <ArrowMap
          title="Direction and magnitude over the image"
          note="Mean residual in each cell. Random directions are noise; a pattern is an error of the camera model."
          size={camera.image_size}
          field={field}
          values={field.rms}
        />
        <Histogram {...histogram} />
        <GroupBars title="Per frame" names={byFrame.frame.map((i) => frames[i]?.name ?? "")} sums={byFrame} unit="frame" />
        <GroupBars title="Per marker" names={markers.marker.map(String)} sums={markers} unit="marker" />
        {types.type.length > 0 && (
          <GroupBars title="Per lens type" names={types.type.map(String)} sums={types} unit="lens type (the numbers are names)" />
        )}
      </Figures>
    </>
  );
}

export function Coverage({ camera, frames }: { camera: ReportCamera; frames: Frames }) {
  const { sample, field, depth } = camera.plots;
  const size = camera.image_size;
  const used = sample.x.map((_, i) => i).filter((i) => sample.used[i] === 1);
  const depths = used.map((i) => sample.depth[i] ?? 0);
  const [near, far] = rangeOf(depths);
  return (
    <>
      <h3>{camera.name}</h3>
      <Figures>
        <PointChart
          title="Points in the image"
          note={`Colour: depth. ${everyKth(sample)}`}
          aspect={imageAspect(size)}
          {...imageAxes(size)}
          groups={[
            {
              label: "points",
              colour: "--series-0",
              radius: 2,
              points: used.map((i) => [sample.x[i] ?? 0, sample.y[i] ?? 0]),
              tint: (k) => ramp(((depths[k] ?? 0) - near) / (far - near || 1)),
            },
          ]}
          words={(_, k) => `${pointName(sample, frames, used[k] ?? 0)}, depth ${brief(depths[k])} m`}
        >
          <ColourScale low={`${brief(near)} m`} high={`${brief(far)} m`} />
        </PointChart>
        <CellMap
          title="Points in each part of the image"
          note="Empty: no points; the distortion is extrapolated there."
          size={size}
          grid={field}
          values={field.points.map((n) => (n > 0 ? n : null))}
          unit="points"
          range={[0, Math.max(1, rangeOf(field.points)[1])]}
        />
        {depth && (
          <BarChart
            title="Depth"
            note="z of the markers in the camera's frame."
            names={depth.middles.map((z) => `${brief(z)} m`)}
            middles={depth.middles}
            x="depth, m"
            y={{ label: "points" }}
            series={[{ label: "points", values: depth.counts, colour: "--series-0" }]}
            aspect={imageAspect(size)}
          />
        )}
      </Figures>
    </>
  );
}
