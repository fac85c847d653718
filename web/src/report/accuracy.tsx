// SPDX-License-Identifier: Apache-2.0
// What a calibration is worth in millimetres: sigma of points and lengths over distance and image.
import type { Accuracy, AccuracyAtDistance, Finding } from "../api/calibration";
import { brief, isKnown } from "../base/numbers";
import { FindingsBox } from "../parts/findings";
import type { Cell } from "../parts/table";
import { Table } from "../parts/table";
import { CellMap } from "../plot/image_field";
import type { Grid, Size } from "../plot/image_field";
import { LineChart } from "../plot/line_chart";
import { Figures, Note, SectionPage } from "./page";
import type { AccuracyPageData, MappedAccuracy } from "./types";

const millimetres = (value: number | null | undefined): number | null => (isKnown(value) ? 1e3 * value : null);
const nameOf = ({ cameras }: Accuracy): string => cameras.join(" + ");
const isDeep = ({ distances }: Accuracy): boolean => distances.some(({ z }) => z !== null);

function AccuracyChart({ accuracy, title }: { accuracy: Accuracy; title: string }) {
  const { distances } = accuracy;
  const budgets = distances.map(({ z, lateral }) => (isDeep(accuracy) ? z : lateral));
  const part = (key: "median" | "noise" | "calibration" | "scale" | "jitter") => budgets.map((budget) => millimetres(budget?.[key]));
  const parts = [
    { label: "from noise of the image points", values: part("noise"), colour: "--faint" },
    { label: "from errors of the calibration", values: part("calibration"), colour: "--series-1" },
    { label: "from the target's scale", values: part("scale"), colour: "--series-2" },
    { label: "from cameras that do not expose at once", values: part("jitter"), colour: "--series-3" },
  ].filter(({ values }) => values.some((value) => isKnown(value) && value > 0));
  return (
    <LineChart
      title={title}
      note={`Standard deviation of ${isDeep(accuracy) ? "z" : "x and y"} of one point from one instant; medians over the image.`}
      breadth="broad"
      aspect={1.8}
      places={distances.map(({ distance }) => distance)}
      x={{ label: "distance, m", logarithmic: true }}
      y={{ label: "sigma, mm", logarithmic: true }}
      series={[{ label: "all", values: part("median"), colour: "--series-0", width: 2.5 }, ...parts]}
    />
  );
}

/** Of a rig or a plenoptic camera, in the report and the workbench. */
export function AccuracyCharts({ accuracy }: { accuracy: Accuracy[] }) {
  if (accuracy.length === 0) return null;
  return (
    <>
      <Note>Points measured from their images, as plenocal triangulate does. More: plenocal accuracy.</Note>
      <Figures>
        {accuracy.map((each) => (
          <AccuracyChart key={each.cameras.join()} accuracy={each} title={`Points seen by ${each.cameras.join(" and ")}`} />
        ))}
      </Figures>
    </>
  );
}

/** The smallest and the largest of all maps, mm: one scale for them. */
function scaleOf(accuracies: MappedAccuracy[]): [number, number] {
  const all = accuracies.flatMap(({ distances }) => distances.flatMap(({ map }) => map.sigma.filter(isKnown)));
  return [1e3 * all.reduce((a, b) => Math.min(a, b), Infinity), 1e3 * all.reduce((a, b) => Math.max(a, b), 0)];
}

function Distances({ accuracy: { distances, bar } }: { accuracy: Accuracy }) {
  const length = `${brief(1e3 * bar)} mm`;
  const columns: [string, (at: AccuracyAtDistance) => number | null | undefined][] = [
    ["sigma of z", ({ z }) => z?.median],
    ["nine tenths have less", ({ z }) => z?.worst],
    ["noise", ({ z }) => z?.noise],
    ["calibration", ({ z }) => z?.calibration],
    ["scale", ({ z }) => z?.scale],
    ["jitter", ({ z }) => z?.jitter],
    ["x, y", ({ lateral }) => lateral.median],
    [`${length} across`, ({ bar_across }) => bar_across],
    [`${length} along`, ({ bar_along }) => bar_along],
    ...Object.keys(distances[0]?.if_known ?? {}).map((name): [string, (at: AccuracyAtDistance) => number | null | undefined] => [
      `z, ${name} known`,
      ({ if_known }) => if_known[name],
    ]),
  ];
  const shown = columns.filter(([, of]) => distances.some((at) => of(at)));
  return (
    <Table
      caption="medians over the image, mm"
      head={["z, m", ...shown.map(([name]) => name)]}
      rows={distances.map((at) => [
        brief(at.distance),
        ...shown.map(([, of]): Cell => ({ text: brief(millimetres(of(at)), 3), value: millimetres(of(at)) })),
      ])}
    />
  );
}

const words = ({ what, remedy }: Finding): string => `${what} ${remedy}`;

function Limits({ limits: { calibration_equals_noise, relative_1_percent, beyond } }: Accuracy) {
  const said = [
    isKnown(calibration_equals_noise) && `calibration and noise have equal shares at ${brief(calibration_equals_noise)} m`,
    isKnown(relative_1_percent) && `sigma of z is 1 % at ${brief(relative_1_percent)} m`,
    isKnown(beyond) && `beyond ${brief(beyond)} m only a least distance is known`,
  ].filter(Boolean);
  return said.length > 0 ? <Note>{said.join("; ")}.</Note> : null;
}

function CameraSet({ accuracy, size, range }: { accuracy: MappedAccuracy; size: Size; range: [number, number] }) {
  const { noise, findings } = accuracy;
  const quantity = isDeep(accuracy) ? "z" : "x, y";
  return (
    <>
      <FindingsBox headline={findings.length > 0 ? "What limits it" : "No remark"} findings={findings.map(words)} />
      <Figures>
        <AccuracyChart accuracy={accuracy} title={`Sigma of ${quantity} over distance`} />
      </Figures>
      <Limits {...accuracy} />
      <Distances accuracy={accuracy} />
      <Note>
        Noise of one coordinate, as one corner of the calibration has it: {Object.entries(noise).map(([name, sigma]) => `${name} ${brief(sigma)} px`).join(", ")}.
        Maps: sigma of {quantity}, over the image of {accuracy.cameras[0]}; one scale for all maps of the page; empty: not in the image of all cameras.
      </Note>
      <Figures small>
        {accuracy.distances.map(
          ({ distance, cells, map }) =>
            cells > 0 && (
              <CellMap
                key={distance}
                title={`${brief(distance)} m`}
                size={size}
                grid={map as Grid}
                values={map.sigma.map(millimetres)}
                unit="mm"
                range={range}
                logarithmic
              />
            ),
        )}
      </Figures>
    </>
  );
}

export function AccuracyPage({ page: { accuracy, image_sizes } }: { page: AccuracyPageData }) {
  const range = scaleOf(accuracy);
  return (
    <SectionPage
      subtitle={accuracy.map(nameOf).join(", ")}
      sections={accuracy.map((each) => ({
        title: nameOf(each),
        content: <CameraSet accuracy={each} size={image_sizes[each.cameras[0] ?? ""] ?? [1, 1]} range={range} />,
      }))}
    />
  );
}
