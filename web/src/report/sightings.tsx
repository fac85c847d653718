// SPDX-License-Identifier: Apache-2.0
// The graph of a rig: a line from each camera to each target that it saw, as thick as the frames are many.
import type { Sightings } from "../api/calibration";
import { rangeOf } from "../base/numbers";
import { Table } from "../parts/table";
import { Note } from "./page";

const kStep = 44;
const kWidth = 560;

export function WhoSawWhat({ cameras, sightings: { targets, seen, common } }: { cameras: string[]; sightings: Sightings }) {
  const height = kStep * Math.max(cameras.length, targets.length) + 16;
  const y = (i: number, n: number): number => height / 2 + kStep * (i - (n - 1) / 2);
  const most = Math.max(1, rangeOf(seen.flat())[1]);
  const lines = seen.flatMap((frames, camera) =>
    frames.map((count, target) => ({ count, from: y(camera, cameras.length), to: y(target, targets.length) })),
  );
  return (
    <>
      <Note>Numbers are frames. Cameras that share no target in any frame are placed by the motion of the rig.</Note>
      <svg viewBox={`0 0 ${kWidth} ${height}`} width={kWidth} height={height} class="graph" font-size={14} fill="currentColor" role="img" aria-label="who saw what">
        {lines
          .filter(({ count }) => count > 0)
          .map(({ count, from, to }, i) => (
            <g key={i}>
              <line x1={140} y1={from} x2={420} y2={to} stroke-width={1 + (7 * count) / most} />
              <text x={210} y={from + (to - from) / 4 - 4} text-anchor="middle" font-size={12}>
                {count}
              </text>
            </g>
          ))}
        {cameras.map((name, i) => (
          <text key={i} x={132} y={y(i, cameras.length) + 5} text-anchor="end">
            {name}
          </text>
        ))}
        {targets.map((name, i) => (
          <text key={i} x={428} y={y(i, targets.length) + 5}>
            {name}
          </text>
        ))}
      </svg>
      <Table
        caption="frames in common"
        head={["", ...cameras]}
        rows={cameras.map((name, i) => [name, ...(common[i] ?? []).map((n) => ({ text: String(n), value: n }))])}
      />
    </>
  );
}
