// SPDX-License-Identifier: Apache-2.0
// The page with 1000 frames of 3 cameras (docs/workbench.md): time to its bars, from a bar to the points, to a preview, of a
// turn in space; memory of the server. With 50 frames: a calibration.
//
//   node bench/workbench.mjs [build/release]
import { execFileSync, spawn } from "node:child_process";
import { cpSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const build = resolve(process.argv[2] ?? "build/release");
const examples = join(dirname(fileURLToPath(import.meta.url)), "../../examples/simulate");
const program = join(build, "apps/plenocal");
const { chromium } = createRequire(join(build, "web/node_modules/"))("playwright-core");

const folder = mkdtempSync(join(tmpdir(), "workbench-bench-"));
cpSync(join(examples, "board.yaml"), join(folder, "board.yaml"));

/** A folder with detections of cameras side by side, and its first run. */
function calibrated(name, frames, cameras) {
  const [head, camera] = readFileSync(join(examples, "one_camera.yaml"), "utf8").replace("frames: 30", `frames: ${frames}`).split("  cam:\n");
  const place = (x) => `    T_camera_rig: [[1, 0, 0, ${x}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n`;
  const each = Array.from({ length: cameras }, (_, i) => `  camera${i}:\n${camera}${i > 0 ? place(0.1 * i) : ""}`);
  writeFileSync(join(folder, `${name}.yaml`), head + each.join(""));
  execFileSync(program, ["simulate", `${name}.yaml`, "--points", "-o", name, "--quiet"], { cwd: folder });
  execFileSync(program, ["calibrate", `${name}/session.yaml`, "-o", `${name}/runs/1`, "--quiet", "--no-report"], { cwd: folder });
  return join(folder, name);
}

async function serve(place) {
  const server = spawn(program, ["workbench", place, "--no-open"]);
  return { server, address: await new Promise((done) => server.stdout.once("data", (data) => done(String(data).split("\n")[0]))) };
}

const large = calibrated("large", 1000, 3);
const began = performance.now();
const { server, address } = await serve(large);
console.log(`server ready: ${Math.round(performance.now() - began)} ms`);
const browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args: ["--no-sandbox"] });
const page = await browser.newPage({ viewport: { width: 1300, height: 900 } });
const timed = async (name, work) => {
  const start = performance.now();
  await work();
  console.log(`${name}: ${Math.round(performance.now() - start)} ms`);
};
await timed("page with the bars of all frames", async () => {
  await page.goto(address);
  await page.getByRole("button", { name: "Results", exact: true }).click();
  await page.locator("[data-bars='1000'] canvas").first().waitFor();
});
await timed("from a bar to the points", async () => {
  const box = await page.locator("[data-bars='1000'] .u-over").first().boundingBox();
  await page.mouse.click(box.x + 0.7 * box.width, box.y + 0.5 * box.height);
  await page.locator("canvas[data-points]:not([data-points='0'])").waitFor();
});
await timed("from leaving out an image to what it changes", async () => {
  await page.keyboard.press("x");
  await page.locator("[data-preview]").waitFor();
});
await page.keyboard.press("Control+z");
console.log(`elements of the page: ${await page.evaluate(() => document.querySelectorAll("*").length)}`);
await page.getByRole("button", { name: "Space", exact: true }).click();
await page.locator("canvas.space").waitFor();
await page.waitForTimeout(500);
const turn = await page.evaluate(async () => {
  const canvas = document.querySelector("canvas.space");
  const times = [];
  for (let i = 0; i < 30; ++i) {
    const start = performance.now();
    canvas.dispatchEvent(new PointerEvent("pointermove", { buttons: 1, movementX: 3, movementY: 1, bubbles: true }));
    await new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
    times.push(performance.now() - start);
  }
  return times.sort((a, b) => a - b)[15];
});
console.log(`a turn of 3000 cameras in space: ${Math.round(turn)} ms`);
console.log(`memory of the server: ${/VmHWM:\s+(\d+)/.exec(readFileSync(`/proc/${server.pid}/status`, "utf8"))[1] / 1024 | 0} MB`);
server.kill();
const small = await serve(calibrated("small", 50, 1));
await page.goto(small.address);
await page.getByRole("button", { name: "Results", exact: true }).click();
await page.locator("[data-bars='50'] canvas").first().waitFor();
await timed("50 frames calibrated again, from the click to the picture", async () => {
  await page.getByRole("button", { name: "Calibrate again (c)" }).click();
  await page.locator("main[data-run='2'] [data-bars='50'] canvas").first().waitFor();
});
small.server.kill();
await browser.close();
rmSync(folder, { recursive: true, force: true });
