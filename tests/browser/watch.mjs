// SPDX-License-Identifier: Apache-2.0
// Recording beside the workbench: images arrive in the folder, and calibration and suggestions follow.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { cpSync, existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { kPatience, look, problems, program, source, testPage } from "./harness.mjs";

const folder = mkdtempSync(join(tmpdir(), "plenocal-watch-"));
mkdirSync(join(folder, "left"));
const name = (number) => `left${String(number).padStart(2, "0")}.jpg`;
const arrive = (number) => cpSync(join(source, name(number)), join(folder, "left", name(number)));
writeFileSync(
  join(folder, "session.yaml"),
  "plenocal: 1\ntarget: target.yaml\ncameras:\n  left: {model: pinhole-radtan4, images: left/*.jpg}\n",
);
writeFileSync(join(folder, "target.yaml"), "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 6\nsquare: 25 mm\n");

async function recording(page, steps) {
  const framesOf = (count) => page.locator(`p[data-frames='${count}']`).waitFor({ timeout: kPatience });
  const saw = (number) => page.locator(`p[data-last='left/${name(number).replace(".jpg", "")}']`).waitFor({ timeout: kPatience });
  steps("watching begins before the first image");
  await page.getByRole("button", { name: "Next views" }).click();
  await page.getByRole("button", { name: "Watch the folders" }).click();
  await page.getByText("Save images into the folders").waitFor({ timeout: kPatience });

  steps("the first images give a calibration and suggestions");
  for (const number of [1, 2, 3, 4, 5]) arrive(number);
  await framesOf(5);
  await page.locator(".suggestions li").first().waitFor({ timeout: kPatience });

  steps("an image that is still being written waits; a broken one is named and left out");
  const whole = readFileSync(join(source, name(6)));
  writeFileSync(join(folder, "left", name(6)), whole.subarray(0, whole.length / 2));
  await saw(6);
  await page.locator("p.problem[data-last]").waitFor({ timeout: kPatience });
  writeFileSync(join(folder, "left", name(6)), whole);
  await framesOf(6);
  await page.getByText(/ 5 frames: .*; 6 frames: /).waitFor({ timeout: kPatience });

  steps("each further image is in the next result");
  // Before its calibration is done the page has it: sigma, coverage and next view go on from the run before, once that is read.
  let count = 6;
  const now = () => page.locator("p[data-renewed]", { hasText: `${count} frames` });
  do {
    await page.waitForTimeout(1500);
    arrive(++count);
    await page.locator(`p[data-frames='${count}']`).or(now()).first().waitFor({ timeout: kPatience });
  } while (count < 8 && !(await now().isVisible()));
  console.log(await now().textContent({ timeout: 1000 }));
  await framesOf(count);
  await page.getByText(new RegExp(` 5 frames: .*; 6 frames: .*; ${count} frames: `)).waitFor({ timeout: kPatience });
  assert.ok(existsSync(join(folder, "runs/1/calibration.yaml")));
  assert.ok(!existsSync(join(folder, "runs/2")), "images that arrive go on in one run");
  await look(page, "watch");

  steps("the result is that of the command line");
  await page.getByRole("button", { name: "Stop watching" }).click();
  await page.getByRole("button", { name: "Watch the folders" }).waitFor({ timeout: kPatience });
  execFileSync(program, ["calibrate", "session.yaml", "-o", "by_hand", "--quiet"], { cwd: folder });
  const parameters = (file) => /parameters: \{(.*)\}/.exec(readFileSync(join(folder, file), "utf8"))[1];
  assert.equal(parameters("runs/1/calibration.yaml"), parameters("by_hand/calibration.yaml"));
  arrive(count + 1);
  await page.waitForTimeout(2500);
  assert.equal(await page.locator(`p[data-frames='${count + 1}']`).count(), 0, "nothing is watched any more");
  // The broken image cannot be shown.
  assert.deepEqual(problems.splice(0).filter((problem) => !/left06|status of 400/.test(problem)), []);
}

await testPage({ folder }, recording);
