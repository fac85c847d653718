// SPDX-License-Identifier: Apache-2.0
// A headline with findings that have no grade of their own.

export function FindingsBox({ headline, findings }: { headline: string; findings: string[] }) {
  return (
    <div class={`verdict ${findings.length > 0 ? "usable" : "good"}`}>
      <strong>{headline}</strong>
      {findings.map((finding, i) => (
        <p key={i}>{finding}</p>
      ))}
    </div>
  );
}
