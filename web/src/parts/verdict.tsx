// SPDX-License-Identifier: Apache-2.0
// Grade, headline and findings with their remedies.
import type { ComponentChildren } from "preact";
import type { Verdict } from "../api/calibration";

interface Shown {
  verdict: Verdict;
  headline: string;
  /** Of findings that ask for an action; all without it. */
  most?: number;
  /** Below the headline. */
  children?: ComponentChildren;
}

export function VerdictBox({ verdict: { grade, findings }, headline, most, children }: Shown) {
  const shown = most === undefined ? findings : findings.filter((finding) => finding.grade !== "good").slice(0, most);
  return (
    <>
      <div class={`verdict ${grade}`}>
        <strong>
          {grade}: {headline}
        </strong>
        {children}
      </div>
      {shown.length > 0 && (
        <ul class="findings">
          {shown.map((finding, i) => (
            <li key={i} class={finding.grade}>
              {finding.what} {finding.remedy && <em>{finding.remedy}</em>}
            </li>
          ))}
        </ul>
      )}
    </>
  );
}
