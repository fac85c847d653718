// SPDX-License-Identifier: Apache-2.0
// The page of `plenocal groundtruth`: what is known how well, the points and the path of both segments.
import { brief, rangeOf } from "../base/numbers";
import { FindingsBox } from "../parts/findings";
import { Table } from "../parts/table";
import { BarChart } from "../plot/bar_chart";
import { Figure } from "../plot/figure";
import { PointChart } from "../plot/point_chart";
import type { PointGroup } from "../plot/point_chart";
import type { Vector } from "../space/geometry";
import { Scene } from "../space/scene";
import { Figures, SectionPage } from "./page";
import type { LoopTruth } from "./types";

const kSegments = ["start", "end"] as const;

function Result({ headline, findings, truth, cameras }: LoopTruth) {
  return (
    <>
      <FindingsBox headline={headline} findings={findings} />
      <Table
        caption="segments"
        head={["", "frames", "left out", "first", "last", "extent along its principal directions, m"]}
        rows={kSegments.map((name) => [name, truth.segments[name]] as const).map(([name, s]) => [
          name,
          s.frames.length,
          s.left_out,
          s.frames[0] ?? "",
          s.frames.at(-1) ?? "",
          s.extent.map((v) => brief(v, 2)).join(", "),
        ])}
      />
      <Table
        caption="points and observations"
        head={[]}
        rows={[
          ["points", truth.points],
          ["of them in both segments", truth.common],
          ["observations", truth.observations],
          ...cameras.map((camera): [string, string] => [`RMS of ${camera.name}, px`, brief(camera.rms)]),
        ]}
      />
      <Table
        caption="alignment error of a perfect estimate (floor of e_align)"
        head={["loop, m", "floor, mm"]}
        rows={truth.floors.map(([length, floor]) => [String(length), { text: brief(1e3 * floor, 2), value: floor }])}
      />
    </>
  );
}

function PointsAndPath({ truth, cameras, frames, markers }: LoopTruth) {
  const top = (places: Vector[]): [number, number][] => places.map(([x, , z]) => [x, z]);
  const of = (common: boolean): Vector[] => markers.filter((marker) => marker.common === common).map((marker) => marker.place);
  const groups: PointGroup[] = [
    { label: "points", colour: "--faint", radius: 1, points: top(of(false)) },
    { label: "points of both", colour: "--series-2", radius: 1.5, points: top(of(true)) },
    { label: "start", colour: "--series-0", radius: 2, points: top(truth.segments.start.path), line: true },
    { label: "end", colour: "--series-1", radius: 2, points: top(truth.segments.end.path), line: true },
  ];
  const ends = (k: 0 | 1): [number, number] => {
    const [low, high] = rangeOf(groups.flatMap(({ points }) => points.map((p) => p[k])));
    const edge = 0.03 * (high - low || 1);
    return [low - edge, high + edge];
  };
  return (
    <Figures>
      <Figure title="Target and camera poses" note="Points of the scene and poses of the rig. Drag to rotate, with Shift to move." breadth="wide">
        <Scene markers={markers.map((marker) => marker.place)} cameras={cameras} frames={frames} />
      </Figure>
      <PointChart
        title="From above"
        note="x to the right, z forward, in the frame of the first rig pose. Points that both segments show are green."
        breadth="wide"
        aspect={1.4}
        x={{ label: "x, m", range: ends(0) }}
        y={{ label: "z, m", range: ends(1) }}
        groups={groups}
        words={(group, i) => `${groups[group]?.label}: ${groups[group]?.points[i]?.map((v) => brief(v)).join(", ")} m`}
      />
    </Figures>
  );
}

function Frames({ frames }: LoopTruth) {
  const common = { breadth: "wide" as const, aspect: 3, names: frames.map((frame) => frame.name) };
  return (
    <Figures>
      <BarChart
        {...common}
        title="Reprojection error"
        note="RMS of the residuals of each frame."
        y={{ label: "px" }}
        unit="px"
        series={[{ label: "RMS", values: frames.map((frame) => frame.rms), colour: "--series-0" }]}
      />
      <BarChart
        {...common}
        title="Points"
        note="Used observations of each frame; those of points that both segments show."
        y={{ label: "observations" }}
        series={[
          { label: "observations", values: frames.map((frame) => frame.observations), colour: "--faint" },
          { label: "of common points", values: frames.map((frame) => frame.common), colour: "--series-2" },
        ]}
      />
      <BarChart
        {...common}
        title="Position"
        note="Standard error of the rig's position against the first pose."
        y={{ label: "mm" }}
        unit="mm"
        series={[{ label: "position", values: frames.map((frame) => 1e3 * frame.position_sigma), colour: "--series-0" }]}
      />
    </Figures>
  );
}

export function TruthPage({ page }: { page: LoopTruth }) {
  return (
    <SectionPage
      subtitle={`${page.cameras.map(({ name }) => name).join(", ")}; ${page.frames.length} frames, ${page.truth.points} points`}
      sections={[
        { title: "Result", content: <Result {...page} /> },
        { title: "Points and path", content: <PointsAndPath {...page} /> },
        { title: "Frames", content: <Frames {...page} /> },
      ]}
    />
  );
}
