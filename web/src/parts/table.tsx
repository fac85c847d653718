// SPDX-License-Identifier: Apache-2.0
// Tables: values beside their text, parameters with their standard errors.
import type { Parameter } from "../api/calibration";
import { unitText, withSigma } from "../base/numbers";

/** Text, and the number that it stands for. */
export type Cell = string | number | { text: string; value?: number | null | undefined; words?: boolean };

function Data({ cell }: { cell: Cell }) {
  if (typeof cell !== "object") return <td>{cell}</td>;
  const { text, value, words } = cell;
  return (
    <td class={words ? "words" : undefined} data-value={value ?? undefined}>
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
