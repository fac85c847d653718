// SPDX-License-Identifier: Apache-2.0
// Tables: values beside their text, parameters with their standard errors, those of several cameras side by side.
import type { Camera, Parameter } from "../api/calibration";
import { parametersOf } from "../base/calibration";
import { brief, unitText, withSigma } from "../base/numbers";

/** Text, and the number that it stands for. */
export type Cell = string | number | { text: string; value?: number | null | undefined; sigma?: number | null; words?: boolean };

function Data({ cell }: { cell: Cell }) {
  if (typeof cell !== "object") return <td>{cell}</td>;
  const { text, value, sigma, words } = cell;
  return (
    <td class={words ? "words" : undefined} data-value={value ?? undefined} data-sigma={sigma ?? undefined}>
      {text}
    </td>
  );
}

interface Look {
  caption: string;
  head: readonly string[];
  /** The first cell of a row is its name. */
  rows: readonly (readonly [string, ...Cell[]])[];
}

export function Table({ caption, head, rows }: Look) {
  return (
    <div class="scroll" tabIndex={0}>
      <table>
        <caption>{caption}</caption>
        {head.some(Boolean) && (
          <thead>
            <tr>
              {head.map((text, i) => (
                <th key={i} scope="col">
                  {text}
                </th>
              ))}
            </tr>
          </thead>
        )}
        <tbody>
          {rows.map(([name, ...cells], row) => (
            <tr key={row}>
              <th scope="row">{name}</th>
              {cells.map((cell, i) => (
                <Data key={i} cell={cell} />
              ))}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

/** Cells of a value and its standard error. */
export function sigmaCells(value: number, sigma: number | null): [Cell, Cell] {
  const [text, error] = withSigma(value, sigma);
  return [{ text, value }, { text: error, value: sigma }];
}

export function ParameterTable({ caption, parameters }: { caption: string; parameters: readonly Parameter[] }) {
  return (
    <Table
      caption={caption}
      head={["", "value", "standard error", "unit"]}
      rows={parameters.map(({ name, value, sigma, unit }) => [name, ...sigmaCells(value, sigma), unitText(unit)])}
    />
  );
}

/** "534.50 ± 0.43". */
function bothCell({ value, sigma }: Parameter): Cell {
  const [text, error] = withSigma(value, sigma);
  return { text: sigma ? `${text} ± ${error}` : `${text}, ${error}`, value, sigma };
}

/** Rows of the cameras' parameters; a camera without one has no number there. */
function rowsOfCameras(parameters: readonly (readonly Parameter[])[]): [string, ...Cell[]][] {
  const units = new Map(parameters.flat().map(({ name, unit }) => [name, unit]));
  return [...units].map(([name, unit]) => [
    name,
    ...parameters.map((of): Cell => {
      const found = of.find((each) => each.name === name);
      return found ? bothCell(found) : "";
    }),
    unitText(unit),
  ]);
}

/** Fit and parameters of all cameras. */
export function CamerasTable({ cameras }: { cameras: readonly Camera[] }) {
  const row = (name: string, of: (camera: Camera) => Cell, unit = ""): [string, ...Cell[]] => [name, ...cameras.map(of), unit];
  return (
    <Table
      caption="parameters ± standard errors"
      head={["", ...cameras.map(({ name }) => name), ""]}
      rows={[
        row("model", ({ model }) => model),
        row("RMS", ({ rms }) => brief(rms), "px"),
        row("noise", ({ noise }) => brief(noise), "px"),
        row("noise stated by the detector", ({ detector_sigma }) => brief(detector_sigma), "px"),
        row("points, rejected", ({ points, rejected }) => `${points}, ${rejected}`),
        ...rowsOfCameras(cameras.map(parametersOf)),
      ]}
    />
  );
}

/** Poses of a rig's cameras; nothing for a single camera. */
export function ExtrinsicsTable({ cameras }: { cameras: readonly Camera[] }) {
  const [master, ...others] = cameras;
  if (!master || others.length === 0) return null;
  return (
    <Table
      caption={`poses in the frame of ${master.name} ± standard errors`}
      head={["", ...others.map(({ name }) => name), ""]}
      rows={rowsOfCameras(others.map(({ extrinsics }) => extrinsics))}
    />
  );
}
