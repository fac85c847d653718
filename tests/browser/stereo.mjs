// SPDX-License-Identifier: Apache-2.0
// A stereo pair: previews without distortion and rectified, and exported files, are those that the command line writes.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { cpSync, mkdirSync, mkdtempSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { kPatience, look, program, source, testPage } from "./harness.mjs";

const folder = mkdtempSync(join(tmpdir(), "plenocal-stereo-"));
for (const camera of ["left", "right"]) {
  mkdirSync(join(folder, camera));
  for (const name of readdirSync(source).filter((each) => each.startsWith(camera) && each.endsWith(".jpg"))) {
    cpSync(join(source, name), join(folder, camera, name.replace(camera, "")));
  }
}
writeFileSync(join(folder, "session.yaml"), `plenocal: 1
target: {type: chessboard, columns: 9, rows: 6, square: 25 mm, tolerance: 0.25 mm}
cameras:
  left: {model: pinhole-radtan4, images: left/*.jpg}
  right: {model: pinhole-radtan4, images: right/*.jpg}
`);
const run = (...words) => execFileSync(program, [...words, "--quiet"], { cwd: folder });
run("calibrate", "session.yaml", "-o", "runs/1");
run("undistort", "runs/1/calibration.yaml", "--camera", "right", "right/03.jpg", "-o", "straight");
run("rectify", "runs/1/calibration.yaml", "left/03.jpg", "right/03.jpg", "-o", "pair");

/** Mean difference of the shown picture and files side by side, grey values of 255. */
async function differenceFrom(page, files) {
  const pictures = files.map((file) => readFileSync(join(folder, file)).toString("base64"));
  return page.evaluate(async (encoded) => {
    const shown = document.querySelector(".lined img");
    const canvas = new OffscreenCanvas(shown.naturalWidth, shown.naturalHeight).getContext("2d");
    const values = () => canvas.getImageData(0, 0, shown.naturalWidth, shown.naturalHeight).data;
    canvas.drawImage(shown, 0, 0);
    const ours = values();
    let x = 0;
    for (const each of encoded) {
      const bytes = Uint8Array.from(atob(each), (c) => c.charCodeAt(0));
      const bitmap = await createImageBitmap(new Blob([bytes]));
      canvas.drawImage(bitmap, x, 0);
      x += bitmap.width;
    }
    if (x !== shown.naturalWidth) return Infinity;
    const theirs = values();
    return ours.reduce((sum, value, i) => sum + Math.abs(value - theirs[i]), 0) / ours.length;
  }, pictures);
}

await testPage({ folder, height: 1600 }, async (page, steps) => {
  await page.evaluate(() => (location.hash = "#/look/right/03?run=1"));
  await page.locator("canvas[data-points='54'][data-loaded=yes]").waitFor({ timeout: kPatience });
  for (const [kind, files] of [["undistorted", ["straight/03.png"]], ["rectified with left", ["pair/left/03.png", "pair/right/03.png"]]]) {
    steps(kind);
    await page.getByLabel("preview").selectOption({ label: kind });
    await page.getByRole("img", { name: files.length === 1 ? "without distortion" : "rectified" }).waitFor({ timeout: kPatience });
    await page.locator(".lined img").evaluate((image) => image.decode());
    const difference = await differenceFrom(page, files);
    assert.ok(difference < 1.5, `${kind}: ${difference} grey values`);
    await look(page, files.length === 1 ? "undistorted" : "rectified");
  }

  steps("files for another program have the names that it expects");
  run("export", "runs/1/calibration.yaml", "--format", "mrcal", "-o", "by_hand.cameramodel");
  await page.getByRole("button", { name: "Export", exact: true }).first().click();
  await page.getByLabel("format").selectOption("mrcal");
  await page.locator("main").getByRole("button", { name: "Export", exact: true }).click();
  for (const camera of ["left", "right"]) {
    const download = page.waitForEvent("download");
    await page.getByRole("button", { name: `Save camera_${camera}.cameramodel` }).click();
    const saved = await download;
    assert.equal(saved.suggestedFilename(), `camera_${camera}.cameramodel`);
    assert.equal(readFileSync(await saved.path(), "utf8"), readFileSync(join(folder, `by_hand_${camera}.cameramodel`), "utf8"));
  }
});
