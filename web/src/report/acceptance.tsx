// SPDX-License-Identifier: Apache-2.0
// The page of `plenocal accept`: pass or fail, deviations against their limits, all lengths.
import { brief } from "../base/numbers";
import type { Cell } from "../parts/table";
import { Table } from "../parts/table";
import { LineChart } from "../plot/line_chart";
import { Figures, Note, SectionPage } from "./page";
import type { AcceptancePageData } from "./types";

const millimetres = (value: number, digits: number): Cell => ({ text: brief(1e3 * value, digits), value: 1e3 * value });

function Deviations({ measured }: AcceptancePageData) {
  const sorted = [...measured].sort((a, b) => a.reference - b.reference);
  const limit = sorted.map(({ limit: of }) => 1e3 * of);
  return (
    <Figures>
      <LineChart
        title="Deviations over the length"
        note="Measured less reference length, of each frame; between the lines it passes."
        breadth="wide"
        aspect={2.2}
        places={sorted.map(({ reference }) => reference)}
        x={{ label: "reference length, m" }}
        y={{ label: "deviation, mm" }}
        series={[
          { label: "deviation", values: sorted.map(({ deviation }) => 1e3 * deviation), colour: "--series-0", dots: true },
          { label: "limit", values: limit, colour: "--series-1" },
          { label: "limit below", values: limit.map((of) => -of), colour: "--series-1" },
        ]}
      />
    </Figures>
  );
}

export function AcceptancePage({ page }: { page: AcceptancePageData }) {
  const { passes, lacks, left_out, findings, lengths, lines, volume, rms, largest, measured } = page;
  return (
    <SectionPage
      subtitle={`${lengths} lengths on ${lines} lines; volume of the ends ${volume.map((side) => `${brief(1e3 * side, 3)} mm`).join(" x ")}`}
      sections={[
        {
          title: "Result",
          content: (
            <>
              <div class={`verdict ${passes ? "good" : "bad"}`}>
                <strong>{passes ? "Pass" : "Fail"}</strong>
                <p>
                  RMS deviation {brief(1e3 * rms)} mm, at most {brief(1e3 * largest)} mm.
                </p>
                {lacks.length > 0 && <p>No complete test after VDI/VDE 2634 part 1; it lacks: {lacks.join("; ")}.</p>}
                {left_out.length > 0 && <p>Not measured: {left_out.join("; ")}.</p>}
                {findings.map(({ what, remedy }, i) => (
                  <p key={i}>
                    {what} {remedy}
                  </p>
                ))}
              </div>
              <Deviations {...page} />
            </>
          ),
        },
        {
          title: "Lengths",
          content: (
            <>
              <Note>mm; sigma: of the deviation, by noise, calibration and reference.</Note>
              <Table
                caption="each length in each frame"
                head={["line", "of", "frame", "reference", "measured", "sigma", "deviation", "limit", ""]}
                rows={measured.map(({ line, of, frame, reference, measured: found, sigma, deviation, limit }) => [
                  line,
                  of,
                  frame,
                  ...[reference, found].map((length) => millimetres(length, 6)),
                  ...[sigma, deviation, limit].map((length) => millimetres(length, 3)),
                  Math.abs(deviation) <= limit ? "passes" : "fails",
                ])}
              />
            </>
          ),
        },
      ]}
    />
  );
}
