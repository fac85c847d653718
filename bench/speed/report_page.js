#!/usr/bin/env node
// SPDX-License-Identifier: Apache-2.0
// Size and speed of report.html of a large calibration, in headless Chromium:
//
//   bench/speed/report_page.js build/release/apps/plenocal OUT [FRAMES]
//
// Simulates the points of a stereo pair before a board of 144 markers, calibrates, and opens the page: time until its text is
// painted, until its components are ready, until every figure has been drawn (a reader sees only those near the window), for
// a turn of the view in space, and for the slowest figure to answer the mouse.
const { execFileSync } = require("node:child_process");
const { mkdirSync, statSync, writeFileSync } = require("node:fs");
const { createRequire } = require("node:module");
const { join, resolve } = require("node:path");

const [program, out] = process.argv.slice(2, 4).map((path) => resolve(path));
const frames = Number(process.argv[4] ?? 1000);
const { chromium } = createRequire(join(program, "../../web/node_modules/"))("playwright-core");

const camera = (more) => ({
  model: "pinhole-radial3",
  image_size: [1280, 960],
  parameters: { f_x: 900, f_y: 901, c_x: 636, c_y: 483, A_0: -0.21, A_1: 0.07, A_2: -0.012 },
  ...more,
});
const target = { plenocal: 1, type: "aprilgrid", columns: 6, rows: 6, size: 0.055, spacing: 0.3, tolerance: 0.0003 };
const spec = {
  plenocal: 1,
  seed: 3,
  target: "target.yaml",
  poses: { kind: "varied", frames, distance: [0.4, 1.2] },
  cameras: { left: camera({}), right: camera({ xi_camera_rig: [-0.1, 0.001, -0.002, 0.005, -0.02, 0.01] }) },
};

/** Measured inside of the page. */
async function measure() {
  const settled = () => new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
  const timed = async (act) => {
    const start = performance.now();
    act();
    await settled();
    return performance.now() - start;
  };
  const median = async (act) => {
    const times = [];
    for (let i = 0; i < 15; ++i) times.push(await timed(act));
    return times.sort((a, b) => a - b)[7];
  };
  const { plenocalReport } = window;
  const all = await timed(() => plenocalReport.drawAll());
  const scene = document.querySelector("canvas.space");
  scene.scrollIntoView();
  await settled();
  const move = { buttons: 1, movementX: 3, movementY: 1, bubbles: true };
  const turn = await median(() => scene.dispatchEvent(new PointerEvent("pointermove", move)));
  let hover = 0;
  for (const over of document.querySelectorAll(".u-over")) {
    const { left, top, width, height } = over.getBoundingClientRect();
    const start = performance.now();
    over.dispatchEvent(new MouseEvent("mousemove", { clientX: left + width / 2, clientY: top + height / 2, bubbles: true }));
    hover = Math.max(hover, performance.now() - start);
  }
  return {
    paint: performance.getEntriesByName("first-contentful-paint")[0].startTime,
    ready: performance.getEntriesByType("navigation")[0].loadEventEnd,
    elements: document.querySelectorAll("*").length,
    errors: plenocalReport.errors,
    all,
    turn,
    hover,
  };
}

async function main() {
  mkdirSync(out, { recursive: true });
  // JSON is YAML.
  writeFileSync(join(out, "target.yaml"), JSON.stringify(target));
  writeFileSync(join(out, "spec.yaml"), JSON.stringify(spec));
  const run = (...words) => execFileSync(program, [...words, "--quiet"], { cwd: out });
  run("simulate", "spec.yaml", "--points", "-o", "set");
  run("calibrate", "set/session.yaml", "-o", "result");
  const report = join(out, "result/report.html");
  const browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args: ["--no-sandbox"] });
  const page = await browser.newPage({ viewport: { width: 1200, height: 900 } });
  // The second time: of a browser that runs already.
  for (const address of [`file://${report}`, "about:blank", `file://${report}`]) await page.goto(address);
  await page.waitForTimeout(500);
  const { paint, ready, elements, all, turn, hover, errors } = await page.evaluate(measure);
  await browser.close();
  if (errors.length > 0) throw new Error(errors.join("\n"));
  const seconds = (milliseconds) => `${(milliseconds / 1e3).toFixed(2)} s`;
  console.log(
    `${frames} frames: ${(statSync(report).size / 1e6).toFixed(2)} MB; first paint ${seconds(paint)}, ready in ${seconds(ready)}, ` +
      `all figures drawn in ${seconds(all)} more; ${elements} elements; a turn in space ${turn.toFixed(0)} ms, ` +
      `slowest figure under the mouse ${hover.toFixed(0)} ms`,
  );
}

main();
