// SPDX-License-Identifier: Apache-2.0
// A rig of two cameras: parameters side by side and the pose with its standard errors, on the page and in the report.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { cpSync, mkdirSync, mkdtempSync, readdirSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { kPatience, look, program, source as images, testPage } from "./harness.mjs";

const folder = mkdtempSync(join(tmpdir(), "plenocal-rig-"));
for (const camera of ["left", "right"]) {
  mkdirSync(join(folder, camera));
  for (const name of readdirSync(images)) {
    if (name.startsWith(camera)) cpSync(join(images, name), join(folder, camera, name.replace(camera, "")));
  }
}
writeFileSync(
  join(folder, "session.yaml"),
  "plenocal: 1\ntarget: chessboard:9x6:25mm\ncameras:\n  left: {model: pinhole-radtan, images: left/}\n  right: {model: pinhole-radtan, images: right/}\n",
);

async function onThePage(page, steps) {
  steps("both cameras stand side by side, their pose in mm and degrees");
  await page.getByRole("button", { name: "Calibrate", exact: true }).click();
  await page.locator("main[data-view=results][data-run='1']").waitFor({ timeout: kPatience });
  const json = JSON.parse(execFileSync(program, ["calibrate", "session.yaml", "--json", "--quiet", "-o", "by_hand"], { cwd: folder }));
  const cellsOf = (caption, row) =>
    page.locator("table", { hasText: caption }).locator("tr", { has: page.getByRole("rowheader", { name: row, exact: true }) }).locator("td");
  const compare = async (cell, value, sigma) => {
    await cell.waitFor({ timeout: kPatience });
    assert.deepEqual([Number(await cell.getAttribute("data-value")), Number(await cell.getAttribute("data-sigma"))], [value, sigma]);
    assert.match(await cell.innerText(), / ± /);
  };
  const { left, right } = json.cameras;
  await compare(cellsOf("parameters ±", "f_x").nth(0), left.parameters.f_x, left.sigma.f_x);
  await compare(cellsOf("parameters ±", "f_x").nth(1), right.parameters.f_x, right.sigma.f_x);
  for (const { name, value, sigma } of right.extrinsics) await compare(cellsOf("poses in the frame of left", name).first(), value, sigma);
  const baseline = right.extrinsics.find(({ name }) => name === "baseline");
  assert.ok(baseline.value > 75 && baseline.value < 95 && baseline.sigma < 1, JSON.stringify(baseline));
  await look(page, "rig_results");
  await page.getByRole("button", { name: "Space", exact: true }).click();
  await compare(cellsOf("poses in the frame of left", "baseline").first(), baseline.value, baseline.sigma);
  await look(page, "rig_space");
  await page.goto(`file://${join(folder, "by_hand/report.html")}`);
  await cellsOf("poses in the frame of left", "baseline").first().getByText(" ± ").waitFor();
  await look(page, "rig_report");
}

await testPage({ folder }, onThePage);
