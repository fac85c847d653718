// SPDX-License-Identifier: Apache-2.0
// A plenoptic camera in the workbench: its raw image, focused image and virtual depth are linked.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { kPatience, look, program, source, testPage } from "./harness.mjs";

const kFrame = "000100";
const folder = mkdtempSync(join(tmpdir(), "plenocal-plenoptic-"));
execFileSync(program, ["simulate", source, "-o", folder, "--quiet"]);
const text = (name) => readFileSync(join(folder, name), "utf8");

/** Measurements of the frame's markers in run 1. */
function markersOf(frame) {
  const [head, ...rows] = text("runs/1/residuals.csv").trim().split("\n").map((line) => line.split(","));
  const column = (row, name) => row[head.indexOf(name)];
  const markers = new Map();
  for (const row of rows.filter((each) => column(each, "frame") === frame)) {
    const marker = column(row, "marker");
    markers.set(marker, [...(markers.get(marker) ?? []), [Number(column(row, "x")), Number(column(row, "y"))]]);
  }
  return markers;
}

async function linkedViews(page, size, steps) {
  steps("the target's boards are drawn on a sheet each");
  await page.locator("img.target").nth(1).waitFor({ timeout: kPatience });
  await page.getByRole("button", { name: "Calibrate", exact: true }).click();
  await page.locator("main[data-view=results][data-run='1']").waitFor({ timeout: kPatience });
  await page.evaluate((frame) => (location.hash = `#/look/plenoptic/${frame}?run=1`), kFrame);
  await page.getByRole("button", { name: "Virtual depth and focused image" }).click();
  await page.getByRole("img", { name: /^totally focused image/ }).waitFor({ timeout: kPatience });
  await page.locator("footer").getByText("plenocal focus", { exact: false }).waitFor();

  const raw = page.getByRole("img", { name: new RegExp(`^plenoptic ${kFrame}`) });
  await raw.scrollIntoViewIfNeeded();
  const at = async ([x, y]) => {
    const box = await raw.boundingBox();
    return [box.x + (box.width / size) * (x + 0.5), box.y + (box.width / size) * (y + 0.5)];
  };
  const marksOf = async (canvas) =>
    (await canvas.getAttribute("data-marks")).split(" ").filter(Boolean).map((mark) => mark.split(",").map(Number));

  steps("the pointer at one measurement of a marker marks the others");
  const errors = [];
  for (const measured of markersOf(kFrame).values()) {
    if (measured.length < 3) continue;
    await page.mouse.move(...(await at(measured[0])));
    await page.waitForTimeout(50);
    const marks = await marksOf(raw);
    for (const [x, y] of measured.slice(1)) {
      errors.push(Math.min(...marks.map(([u, v]) => Math.hypot(u - x, v - y))));
    }
  }
  errors.sort((a, b) => a - b);
  console.log(`pointer to measurement, px: median ${errors[Math.floor(0.5 * errors.length)].toFixed(2)}, nine of ten ${errors[Math.floor(0.9 * errors.length)].toFixed(2)}`);
  assert.ok(errors.length > 30, `${errors.length} pairs of measurements`);
  assert.ok(errors[Math.floor(0.5 * errors.length)] < 0.5, `median ${errors[Math.floor(0.5 * errors.length)]} px`);
  assert.ok(errors[Math.floor(0.9 * errors.length)] < 1, `nine of ten: ${errors[Math.floor(0.9 * errors.length)]} px`);

  steps("the pointer at that place of the focused image marks the same pixels");
  const [marker, measured] = [...markersOf(kFrame)].find(([, all]) => all.length >= 4);
  const focused = page.getByRole("img", { name: /^totally focused image/ });
  await page.mouse.move(...(await at(measured[0])));
  await page.waitForTimeout(100);
  const [[u, v]] = await marksOf(focused);
  const marked = await marksOf(raw);
  await focused.scrollIntoViewIfNeeded();
  const pane = await focused.boundingBox();
  const zoom = (pane.width / size) * 2; // `focus` halves the image
  await page.mouse.move(pane.x + zoom * (u + 0.5), pane.y + zoom * (v + 0.5));
  await page.waitForTimeout(100);
  const again = await marksOf(raw);
  assert.equal(again.length, marked.length);
  for (const [i, [x, y]] of again.entries()) assert.ok(Math.hypot(x - marked[i][0], y - marked[i][1]) < 1, `${again} for ${marked}`);
  assert.equal((await marksOf(page.getByRole("img", { name: /^virtual depth/ }))).length, 1);

  steps("a click shows the micro images of a marker side by side");
  await raw.scrollIntoViewIfNeeded();
  await page.mouse.click(...(await at(measured[0])));
  await page.getByText(`point ${marker}: in ${measured.length} micro images`).waitFor({ timeout: kPatience });
  assert.equal(await page.locator(".micro canvas").count(), measured.length);
  await page.mouse.move(...(await at(measured[0])));
  await look(page, "plenoptic");
}

await testPage({ folder, height: 1600 }, (page, steps) => linkedViews(page, 420, steps));
