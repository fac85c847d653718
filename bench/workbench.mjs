// SPDX-License-Identifier: Apache-2.0
// The page with 1000 frames of 3 cameras (docs/workbench.md): time to its bars, from a bar to the points, of a turn in
// space; memory of the server.
//
//   node bench/workbench.mjs [build/release]
import { execFileSync, spawn } from "node:child_process";
import { cpSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const build = resolve(process.argv[2] ?? "build/release");
const examples = join(dirname(fileURLToPath(import.meta.url)), "../examples/simulate");
const program = join(build, "apps/plenocal");
const { chromium } = createRequire(join(build, "web/node_modules/"))("playwright-core");

const folder = mkdtempSync(join(tmpdir(), "workbench-bench-"));
cpSync(join(examples, "board.yaml"), join(folder, "board.yaml"));
const text = readFileSync(join(examples, "one_camera.yaml"), "utf8").replace("frames: 30", "frames: 1000");
const [head, camera] = text.split("  cam:\n");
const place = (x) => `    T_camera_rig: [[1, 0, 0, ${x}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n`;
writeFileSync(join(folder, "spec.yaml"), `${head}  left:\n${camera}  right:\n${camera}${place(-0.1)}  third:\n${camera}${place(0.1)}`);
execFileSync(program, ["simulate", "spec.yaml", "--points", "-o", "set", "--quiet"], { cwd: folder });
execFileSync(program, ["calibrate", "set/session.yaml", "-o", "set/runs/1", "--quiet", "--no-report"], { cwd: folder });

const began = performance.now();
const server = spawn(program, ["workbench", join(folder, "set"), "--no-open"]);
const address = await new Promise((done) => server.stdout.once("data", (data) => done(String(data).split("\n")[0])));
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
  await page.getByRole("button", { name: "Look", exact: true }).click();
  await page.locator("[data-bars='1000'] canvas").first().waitFor();
});
await timed("from a bar to the points", async () => {
  const box = await page.locator("[data-bars='1000'] .u-over").first().boundingBox();
  await page.mouse.click(box.x + 0.7 * box.width, box.y + 0.5 * box.height);
  await page.locator("canvas[data-points]:not([data-points='0'])").waitFor();
});
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
await browser.close();
server.kill();
rmSync(folder, { recursive: true, force: true });
