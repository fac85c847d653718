// SPDX-License-Identifier: Apache-2.0
// report.html: from the data of a calibration to the page, section by section.
import type { Report, ReportCamera } from "../api/calibration";
import { camerasOf, parametersOf, targetOf } from "../base/calibration";
import { brief, counted } from "../base/numbers";
import { ExtrinsicsTable, ParameterTable, Table } from "../parts/table";
import type { Cell } from "../parts/table";
import { VerdictBox } from "../parts/verdict";
import { Figure } from "../plot/figure";
import { Scene } from "../space/scene";
import { hasWhiteImages, LensTypes, WhiteImages } from "./lenses";
import { Markers } from "./markers";
import { Figures, Note, SectionPage } from "./page";
import { Coverage, Residuals } from "./residuals";
import { WhoSawWhat } from "./sightings";
import { Correlations, UncertaintyInUse } from "./uncertainty";

interface Shown {
  report: Report;
  /** The rig's master first. */
  cameras: ReportCamera[];
}

function Verdict({ report: { verdict, headline }, cameras }: Shown) {
  return (
    <>
      <VerdictBox verdict={verdict} headline={headline}>
        {cameras.map(({ name, summary }) => (
          <div key={name}>{summary}</div>
        ))}
      </VerdictBox>
      {verdict.findings.length === 0 && (
        <Note>All parameters are determined, the points cover the image and a range of distances and tilts, and the residuals are noise.</Note>
      )}
    </>
  );
}

function Parameters({ camera }: { camera: ReportCamera }) {
  const residuals = camera.residual_table.map(([name, value, unit]): [string, Cell, string] => [name, { text: brief(value, 6), value }, unit]);
  const coefficients = Object.keys(camera.parameters).length - camera.units.length;
  return (
    <>
      <h3>
        {camera.name}: {camera.model}, {camera.image_size[0]} x {camera.image_size[1]} px
      </h3>
      <div class="tables">
        <ParameterTable caption="parameters" parameters={parametersOf(camera)} />
        <Table caption="residuals" head={[]} rows={residuals} />
      </div>
      {coefficients > 0 && <Note>The model also has {coefficients} coefficients of a field over the image; see calibration.yaml.</Note>}
      <Note>{camera.source}</Note>
    </>
  );
}

function InSpace({ report, cameras }: Shown) {
  const rms = new Map(
    cameras.flatMap(({ name, plots }) => plots.frames.frame.map((frame, i) => [`${name}/${report.poses[frame]?.name}`, plots.frames.rms[i] ?? null])),
  );
  return (
    <Figures>
      <Figure
        title="Target and camera poses"
        note="Points: markers. Pyramids: cameras of the rig, at their optical centres, not to scale. Drag to rotate, with Shift to move; a click chooses a frame."
        breadth="wide"
      >
        <Scene
          {...targetOf(report)}
          cameras={cameras}
          rms={(camera, frame) => rms.get(`${camera}/${frame}`) ?? null}
        />
      </Figure>
    </Figures>
  );
}

function Samples({ cameras }: { cameras: ReportCamera[] }) {
  const pictures = cameras.flatMap(({ name, sample: { frame, pictures: { picture, depth } } }) => [
    { name, frame, source: picture, note: depth ? "Totally focused image." : "Image." },
    { name, frame, source: depth, note: "Virtual depth: scale on the right; black: no depth could be measured." },
  ]);
  const shown = pictures.filter(({ source }) => source !== undefined);
  if (shown.length === 0) return <Note>No pictures: the points came from files, or sample_&lt;camera&gt;.jpg is not beside this calibration.</Note>;
  return (
    <>
      <Note>The frame with the most markers of each camera; crosses and numbers mark detected markers.</Note>
      <div class="pictures">
        {shown.map(({ name, frame, source, note }, i) => (
          <Figure key={i} title={`${name}, frame ${frame}`} note={note}>
            <img src={source} alt={`${name}, frame ${frame}`} />
          </Figure>
        ))}
      </div>
    </>
  );
}

function LeftOut({ report: { left_out }, cameras }: Shown) {
  const rejected = cameras.filter((camera) => camera.rejected > 0);
  return (
    <>
      {rejected.map(({ name, rejected: points }) => (
        <Note key={name}>
          {name}: {counted(points, "point")} rejected as outliers or outside the model's domain (used = 0 in residuals.csv).
        </Note>
      ))}
      {left_out.length === 0 ? (
        <Note>{rejected.length > 0 ? "No image was left out." : "Nothing was left out."}</Note>
      ) : (
        <ul class="list" tabIndex={0}>
          {left_out.map((text, i) => (
            <li key={i}>{text}</li>
          ))}
        </ul>
      )}
    </>
  );
}

function Reproduce({ provenance }: Report) {
  const values = new Map(provenance);
  const texts: [string, string | undefined][] = [["Session", values.get("session_text")], ["Target, as given", values.get("target_text")]];
  return (
    <>
      {values.get("command") && <pre>{values.get("command")}</pre>}
      <Note>
        Plenocal {values.get("plenocal_version") ?? "of unknown version"}
        {values.get("folder") ? ` in the folder ${values.get("folder")}` : ""}; session {values.get("session") ?? "unknown"}, target{" "}
        {values.get("target") ?? "unknown"}.
      </Note>
      {texts.map(
        ([title, text]) =>
          text && (
            <div key={title}>
              <h3>{title}</h3>
              <pre class="list" tabIndex={0}>
                {text}
              </pre>
            </div>
          ),
      )}
    </>
  );
}

export function CalibrationPage({ report }: { report: Report }) {
  const { poses: frames, markers, sightings } = report;
  const cameras = camerasOf(report);
  const shown = { report, cameras };
  const typed = cameras.filter((camera) => camera.lens_types.length > 0);
  const white = cameras.filter(hasWhiteImages);
  return (
    <SectionPage
      subtitle={`${cameras.map(({ name, model }) => `${name} (${model})`).join(", ")}; ${frames.length} frames, ${markers.length} markers`}
      sections={[
        { title: "Verdict", content: <Verdict {...shown} /> },
        { title: "Parameters", content: <><ExtrinsicsTable cameras={cameras} />{cameras.map((camera) => <Parameters key={camera.name} camera={camera} />)}</> },
        { title: "Residuals", content: <>{cameras.map((camera) => <Residuals key={camera.name} camera={camera} frames={frames} />)}</> },
        { title: "Coverage", content: <>{cameras.map((camera) => <Coverage key={camera.name} camera={camera} frames={frames} />)}</> },
        sightings
          ? { title: "Who saw what", content: <WhoSawWhat cameras={cameras.map(({ name }) => name)} sightings={sightings} /> }
          : null,
        { title: "In space", content: <InSpace {...shown} /> },
        { title: "Markers", content: <Markers report={report} /> },
        { title: "Correlations", content: <Correlations {...report.correlation} /> },
        { title: "Uncertainty in use", content: <UncertaintyInUse cameras={cameras} accuracy={report.accuracy} /> },
        typed.length > 0 ? { title: "Lens types", content: <LensTypes cameras={typed} /> } : null,
        white.length > 0 ? { title: "White images", content: <WhiteImages cameras={white} /> } : null,
        { title: "Sample images", content: <Samples cameras={cameras} /> },
        { title: "Left out", content: <LeftOut {...shown} /> },
        { title: "Reproduce", content: <Reproduce {...report} /> },
      ]}
    />
  );
}
