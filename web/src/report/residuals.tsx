// SPDX-License-Identifier: Apache-2.0
// Residuals and coverage of one camera.
import { useState } from "preact/hooks";
import type { Pose, ReportCamera, Sample, Sums } from "../api/calibration";
import { brief, counted, rangeOf, roundUp } from "../base/numbers";
import { arrow } from "../plot/arrow";
import { BarChart } from "../plot/bar_chart";
import type { Painter } from "../plot/chart";
import { ramp, styled } from "../plot/colours";
import { ColourScale, Figure } from "../plot/figure";
import { FrameBars } from "../plot/frame_bars";
import { ArrowMap, CellMap, imageAspect, imageAxes } from "../plot/image_field";
import { PaintedChart, PointChart } from "../plot/point_chart";
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

interface Group {
  title: string;
  names: string[];
  sums: Sums;
  unit: string;
  chosen?: string;
  onChoose?: (name: string) => void;
}

function GroupBars({ title, names, sums, unit, ...choice }: Group) {
  const breadth = names.length > 150 ? "wide" : names.length > 40 ? "broad" : undefined;
  const bars = names.map((name, i) => ({
    name,
    size: sums.rms[i] ?? null,
    words: `${brief(sums.rms[i])} px, ${sums.points[i]} points, ${sums.rejected[i]} rejected`,
  }));
  return (
    <Figure title={title} note={`RMS reprojection error.${choice.onChoose ? " A click shows the frame." : ""}`} breadth={breadth}>
      <FrameBars name={title} bars={bars} x={unit} y="RMS, px" aspect={breadth === "wide" ? 3.5 : breadth === "broad" ? 2.5 : 1.2} {...choice} />
    </Figure>
  );
}

interface OfFrame {
  camera: ReportCamera;
  frames: Frames;
  /** Index into the frames. */
  index: number;
  /** How many times as long as a residual its arrow is. */
  magnify: number;
}

/** The points of one frame in its image, with their residuals. */
function FrameResiduals({ camera, frames, index, magnify }: OfFrame) {
  const { sample, frames: sums } = camera.plots;
  const points = sample.frame.map((frame, i) => (frame === index ? i : -1)).filter((i) => i >= 0);
  const row = sums.frame.indexOf(index);
  const at = (k: number): [number, number] => [sample.x[points[k] ?? 0] ?? 0, sample.y[points[k] ?? 0] ?? 0];
  const residual = (k: number): [number, number] => [sample.dx[points[k] ?? 0] ?? 0, sample.dy[points[k] ?? 0] ?? 0];
  const paint = ({ canvas, x, y, unit }: Painter): void => {
    canvas.lineWidth = 1.3 * unit;
    points.forEach((i, k) => {
      const [[u, v], [dx, dy]] = [at(k), residual(k)];
      canvas.fillStyle = styled("--good");
      canvas.strokeStyle = styled(sample.used[i] ? "--arrow" : "--bad");
      if (sample.used[i]) canvas.fillRect(x(u) - 1.5 * unit, y(v) - 1.5 * unit, 3 * unit, 3 * unit);
      arrow(canvas, x(u), y(v), x(u + magnify * dx) - x(u), y(v + magnify * dy) - y(v), unit);
    });
  };
  const title = `${camera.name}, frame ${frames[index]?.name}`;
  return (
    <Figure title={title} note={`RMS ${brief(sums.rms[row])} px, ${counted(sums.points[row] ?? 0, "point")}, ${sums.rejected[row]} rejected (red).`}>
      <PaintedChart
        name={title}
        count={points.length}
        aspect={imageAspect(camera.image_size)}
        {...imageAxes(camera.image_size)}
        paint={paint}
        hover={{
          count: points.length,
          at,
          words: (k) => `marker ${sample.marker[points[k] ?? 0]}: (${residual(k).map((v) => brief(v)).join(", ")}) px`,
        }}
      />
    </Figure>
  );
}

const kWorst = 3;

/** Indices of the frames with the largest RMS. */
const worstOf = ({ frame, rms }: ReportCamera["plots"]["frames"]): number[] =>
  frame
    .map((index, row) => ({ index, rms: rms[row] ?? 0 }))
    .sort((a, b) => b.rms - a.rms)
    .slice(0, kWorst)
    .map(({ index }) => index);

/** By which arrows are longer than residuals: 95 of 100 take less than this part of the image's width. */
function magnification({ image_size, plots: { sample } }: ReportCamera): number {
  const lengths = sample.dx.map((dx, i) => (sample.used[i] ? Math.hypot(dx, sample.dy[i] ?? 0) : 0)).sort((a, b) => a - b);
  return (0.06 * image_size[0]) / (lengths[Math.floor(0.95 * (lengths.length - 1))] || 1);
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
  const worst = worstOf(byFrame);
  const [chosen, setChosen] = useState(worst[0] ?? 0);
  const magnify = magnification(camera);
  const names = byFrame.frame.map((i) => frames[i]?.name ?? "");
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
        <GroupBars
          title="Per frame"
          names={names}
          sums={byFrame}
          unit="frame"
          chosen={frames[chosen]?.name ?? ""}
          onChoose={(name) => setChosen(byFrame.frame[names.indexOf(name)] ?? 0)}
        />
        <FrameResiduals index={chosen} {...{ camera, frames, magnify }} />
        <GroupBars title="Per marker" names={markers.marker.map(String)} sums={markers} unit="marker" />
        {types.type.length > 0 && (
          <GroupBars title="Per lens type" names={types.type.map(String)} sums={types} unit="lens type (the numbers are names)" />
        )}
      </Figures>
      <h4>Worst frames</h4>
      <Note>
        Arrows are {brief(magnify, 2)} times as long as the residuals. {everyKth(sample)}
      </Note>
      <Figures small>
        {worst.map((index) => (
          <FrameResiduals key={index} {...{ camera, frames, index, magnify }} />
        ))}
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
