// SPDX-License-Identifier: Apache-2.0
// A page that the program writes: its text stands there already, the components take its place.
import "./report.css";
import { render } from "preact";
import { drawAll, drawings, followColours } from "../plot/drawings";
import type { Drawing } from "../plot/drawings";
import { AcceptancePage } from "../report/acceptance";
import { AccuracyPage } from "../report/accuracy";
import { CalibrationPage } from "../report/calibration";
import { PhotometryPage } from "../report/photometry";
import { TrialPage } from "../report/trial";
import { TruthPage } from "../report/truth";
import type { PageData } from "../report/types";

declare global {
  interface Window {
    /** For tests and benchmarks. */
    plenocalReport: { drawings: Set<Drawing>; drawAll: () => void; errors: string[] };
  }
}

/** When the file was written, "2026-11-28". */
function day(): string {
  const time = new Date(document.lastModified);
  const two = (value: number): string => String(value).padStart(2, "0");
  return `${time.getFullYear()}-${two(time.getMonth() + 1)}-${two(time.getDate())}`;
}

function Page({ data }: { data: PageData }) {
  switch (data.kind) {
    case "calibration":
      return <CalibrationPage report={data} />;
    case "trial":
      return <TrialPage trial={data} />;
    case "acceptance":
      return <AcceptancePage page={data} />;
    case "accuracy":
      return <AccuracyPage page={data} />;
    case "truth":
      return <TruthPage page={data} />;
    case "photometry":
      return <PhotometryPage page={data} />;
  }
}

window.plenocalReport = { drawings, drawAll, errors: [] };
addEventListener("error", (event) => window.plenocalReport.errors.push(event.message));

const text = document.getElementById("page")!;
const made = document.createElement("div");
followColours();
try {
  text.after(made);
  document.title += `, ${day()}`;
  render(<Page data={JSON.parse(document.getElementById("report-data")?.textContent ?? "") as PageData} />, made);
  text.remove();
  made.id = "page";
} catch (error) {
  // The text stays.
  made.remove();
  throw error;
}
