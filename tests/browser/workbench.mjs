// SPDX-License-Identifier: Apache-2.0
// The workbench in a real browser: from a folder of images to an export, exclude and undo, and what
// pages of other origins must not reach.
//
//   node workbench.mjs PROGRAM IMAGES NODE_MODULES [SCREENSHOTS]
import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { cpSync, existsSync, mkdirSync, mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";

const [program, images, modules, screenshots] = process.argv.slice(2).map((path) => resolve(path));
const { chromium } = createRequire(join(modules, "/"))("playwright-core");
const kChromium = "/usr/bin/chromium";
if (!existsSync(kChromium)) {
  console.log(`skipped: ${kChromium} is missing (Debian package chromium)`);
  process.exit(77);
}
const kPatience = 60_000; // ms, of a busy machine

const folder = mkdtempSync(join(tmpdir(), "plenocal-workbench-"));
mkdirSync(join(folder, "left"));
for (const name of readdirSync(images)) {
  if (/^left\d+\.jpg$/.test(name)) cpSync(join(images, name), join(folder, "left", name));
}

let server;
async function startServer() {
  server = spawn(program, ["workbench", folder, "--no-open"]);
  let out = "";
  server.stdout.on("data", (data) => (out += data));
  for (let i = 0; i < 600 && !out.includes("\n"); ++i) await new Promise((done) => setTimeout(done, 50));
  return out.split("\n")[0];
}

const problems = [];
function watch(page) {
  page.on("console", (line) => line.type() === "error" && problems.push(line.text()));
  page.on("pageerror", (error) => problems.push(String(error)));
  page.on("response", (answer) => answer.status() >= 400 && problems.push(`${answer.status()} ${answer.url()}`));
  page.on("request", (request) => {
    const url = new URL(request.url());
    if (url.protocol === "http:" && url.hostname !== "127.0.0.1") problems.push(`left this machine: ${url}`);
    if (url.href.includes(token)) problems.push(`the token in an address: ${url}`);
  });
}

const text = (name) => readFileSync(join(folder, name), "utf8");
async function picture(page, name) {
  if (!screenshots) return;
  for (const [width, scheme] of [[1300, "light"], [1300, "dark"], [420, "light"], [420, "dark"]]) {
    await page.setViewportSize({ width, height: 900 });
    await page.emulateMedia({ colorScheme: scheme });
    await page.waitForTimeout(300);
    await page.screenshot({ path: join(screenshots, `${name}_${width}_${scheme}.jpg`), type: "jpeg", quality: 60 });
    const wide = await page.evaluate(() => document.documentElement.scrollWidth > innerWidth);
    assert.equal(wide, false, `${name} is wider than ${width} px`);
  }
  await page.setViewportSize({ width: 1300, height: 900 });
  await page.emulateMedia({ colorScheme: "light" });
}

async function folderToResult(page, steps) {
  steps("a session is proposed, the missing length is named");
  await page.getByRole("button", { name: "Propose a session" }).click();
  await page.getByText("expected a length in metres").waitFor({ timeout: kPatience });
  const target = page.getByRole("textbox", { name: /^Target/ });
  await target.fill((await target.inputValue()).replace(/^square:.*$/m, "square: 25 mm"));
  await page.locator("section", { has: target }).getByRole("button", { name: "Save" }).click();
  await page.getByText("left: 13 images").waitFor({ timeout: kPatience });
  assert.match(text("target.yaml"), /^square: 25 mm$/m);
  await picture(page, "setup");

  steps("calibration, with the detections on the way");
  await page.getByRole("button", { name: "Calibrate", exact: true }).click();
  await page.locator("main[data-view=look][data-run='1']").waitFor({ timeout: kPatience });
  await page.getByRole("button", { name: "Images", exact: true }).click();
  await page.getByText("13 images looked at, target found in 13").waitFor({ timeout: kPatience });
  await page.locator(".thumb img").first().waitFor({ timeout: kPatience });
  await picture(page, "images");

  steps("the page has the numbers of the files, and these are those of the command line");
  await page.getByRole("button", { name: "Look", exact: true }).click();
  await page.locator("table").first().waitFor({ timeout: kPatience });
  execFileSync(program, ["calibrate", "session.yaml", "-o", "by_hand", "--quiet"], { cwd: folder });
  const parameters = /parameters: \{(.*)\}/.exec(text("by_hand/calibration.yaml"))[1];
  assert.equal(/parameters: \{(.*)\}/.exec(text("runs/1/calibration.yaml"))[1], parameters);
  for (const [, name, value] of parameters.matchAll(/(\w+): ([-\d.e]+)/g)) {
    const cell = page.locator("tr", { has: page.getByRole("rowheader", { name, exact: true }) }).locator("td").first();
    assert.equal(await cell.innerText(), Number(value).toPrecision(8));
  }
}

async function excludeAndUndo(page, steps) {
  steps("the worst bar leads to its image with all corners");
  const bars = await page.locator(".bar").all();
  const worst = await page.evaluate(() => {
    const heights = [...document.querySelectorAll(".bar")].map((bar) => parseFloat(bar.querySelector("span").style.height));
    return heights.indexOf(Math.max(...heights));
  });
  await bars[worst].click();
  const frame = (await bars[worst].getAttribute("title")).split(":")[0];
  await page.locator("canvas[data-points='54'][data-loaded=yes]").waitFor({ timeout: kPatience });
  assert.match(page.url(), new RegExp(`#/look/left/${frame}`));
  await picture(page, "look");
  await page.reload();
  await page.locator("canvas[data-points='54']").waitFor({ timeout: kPatience });
  await page.getByRole("heading", { name: `left / ${frame}` }).waitFor();

  steps("x excludes it, nothing else in the text changes, Ctrl+Z takes it back");
  const before = text("session.yaml");
  await page.keyboard.press("x");
  await page.getByRole("button", { name: "Include again" }).waitFor({ timeout: kPatience });
  assert.equal(text("session.yaml"), `${before}exclude:\n  - {camera: left, frame: ${frame}}\n`);
  await page.locator(".bar.hatched").waitFor();
  await page.keyboard.press("Control+z");
  await page.getByRole("button", { name: "Exclude (x)" }).waitFor({ timeout: kPatience });
  assert.equal(text("session.yaml"), before);
  await page.keyboard.press("Control+Shift+z");
  await page.getByRole("button", { name: "Include again" }).waitFor({ timeout: kPatience });

  steps("the next run is without it, and is compared with the one before");
  await page.keyboard.press("c");
  await page.locator("main[data-view=look][data-run='2']").waitFor({ timeout: kPatience });
  assert.ok(!text("runs/2/residuals.csv").includes(`left,${frame},`));
  await page.getByText(/Against run 1/).waitFor({ timeout: kPatience });
  assert.equal(await page.locator(".bar.hatched").count(), 1, "the excluded frame can be chosen");
}

async function editorBesideThePage(page, steps) {
  steps("a change by an editor shows, a wrong one with its line");
  await page.getByRole("button", { name: "Set up", exact: true }).click();
  const good = text("session.yaml");
  await page.locator("img.target").waitFor({ timeout: kPatience });
  writeFileSync(join(folder, "session.yaml"), good.replace("model: pinhole-radtan", "model: pinhole-radtam"));
  await page.getByText(/session.yaml:\d+.*pinhole-radtam/).first().waitFor({ timeout: kPatience });
  writeFileSync(join(folder, "session.yaml"), good);
  await page.getByText("left: 13 images").waitFor({ timeout: kPatience });
}

async function inSpace(page, steps) {
  steps("cameras in space: hover names one, a click opens its image");
  await page.getByRole("button", { name: "Space", exact: true }).click();
  const canvas = page.locator("canvas[data-cameras='12']");
  await canvas.waitFor({ timeout: kPatience });
  await picture(page, "space");
  const box = await canvas.boundingBox();
  let name = "";
  for (let y = 0.1; y < 0.95 && !name; y += 0.03) {
    for (let x = 0.05; x < 0.95 && !name; x += 0.03) {
      await page.mouse.move(box.x + x * box.width, box.y + y * box.height);
      name = (await page.locator("[data-hover]").getAttribute("data-hover")) ?? "";
    }
  }
  assert.match(name, /^left\/left\d\d$/);
  await page.mouse.down();
  await page.mouse.up();
  await page.getByRole("heading", { name: name.replace("/", " / ") }).waitFor({ timeout: kPatience });
}

async function suggestCompareExport(page, steps) {
  steps("next views, comparison, export with the command line");
  await page.getByRole("button", { name: "Next views" }).click();
  await page.locator(".suggestions li").nth(4).waitFor({ timeout: kPatience });
  await page.locator(".suggestions canvas[data-loaded=yes]").first().waitFor({ timeout: kPatience });
  await picture(page, "next");
  await page.getByRole("button", { name: "Compare", exact: true }).first().click();
  await page.locator("main").getByRole("button", { name: "Compare", exact: true }).click();
  await page.locator("main pre").waitFor({ timeout: kPatience });
  await picture(page, "compare");
  await page.getByRole("button", { name: "Export", exact: true }).first().click();
  await page.locator("main").getByRole("button", { name: "Export", exact: true }).click();
  await page.locator("main pre").waitFor({ timeout: kPatience });
  await picture(page, "export");
  execFileSync(program, ["export", "runs/2/calibration.yaml", "--format", "opencv", "-o", "by_hand.yml"], { cwd: folder });
  assert.equal((await page.locator("main pre").textContent()).trim(), text("by_hand.yml").trim());
  await page.getByText(/plenocal export .*--format opencv/).first().waitFor();
}

async function killedServer(browser, steps) {
  steps("a killed server loses nothing");
  server.kill("SIGKILL");
  await new Promise((done) => server.once("exit", done));
  const address = await startServer();
  token = address.split("token=")[1];
  const page = await browser.newPage();
  watch(page);
  await page.goto(address);
  await page.getByRole("button", { name: "Look", exact: true }).click();
  await page.locator("main[data-run='2']").waitFor({ timeout: kPatience });
  assert.ok(!page.url().includes("token"));
  await page.getByRole("button", { name: "Set up", exact: true }).click();
  assert.equal(await page.getByRole("button", { name: "Undo" }).isEnabled(), true);
  await page.close();
  return address;
}

// What another page in the same browser may try.
async function otherOrigins(browser, address, steps) {
  steps("pages of other origins get nothing and change nothing");
  const base = address.split("/#")[0];
  const before = text("session.yaml");
  const attacker = createServer((request, answer) => {
    answer.setHeader("content-type", "text/html");
    answer.end(`<form id=f method=post action="${base}/api/session/undo" enctype="text/plain"><input name=a></form>
      <iframe src="${base}/"></iframe><img src="${base}/api/state"><script src="${base}/workbench.js"></script>`);
  });
  await new Promise((done) => attacker.listen(0, "127.0.0.1", done));
  const page = await browser.newPage();
  const answers = [];
  page.on("response", (response) => response.url().startsWith(base) && answers.push([response.url().slice(base.length), response.status()]));
  await page.goto(`http://127.0.0.1:${attacker.address().port}/`);
  const read = await page.evaluate(async (url) => {
    try {
      return await (await fetch(url)).text();
    } catch {
      return "refused";
    }
  }, `${base}/api/state`);
  assert.equal(read, "refused");
  await page.evaluate(() => document.getElementById("f").submit());
  await page.waitForTimeout(500);
  assert.equal(text("session.yaml"), before);
  for (const [path, status] of answers) {
    if (path.startsWith("/api")) assert.ok(status >= 400, `${path} was answered with ${status}`);
  }
  const frames = page.frames().filter((frame) => frame.url().startsWith(base));
  for (const frame of frames) assert.equal(await frame.locator("#page").count().catch(() => 0), 0);
  attacker.close();
  await page.close();

  // A name of the attacker that points here (rebinding).
  const rebound = await chromium.launch({
    executablePath: kChromium,
    args: ["--no-sandbox", "--host-resolver-rules=MAP evil.test 127.0.0.1"],
  });
  const other = await rebound.newPage();
  const answer = await other.goto(base.replace("127.0.0.1", "evil.test") + "/");
  assert.equal(answer.status(), 403);
  await rebound.close();
}

let token = "";
let failed = false;
const browser = await chromium.launch({ executablePath: kChromium, args: ["--no-sandbox"] });
try {
  let address = await startServer();
  token = address.split("token=")[1];
  const page = await browser.newPage({ viewport: { width: 1300, height: 900 } });
  watch(page);
  const steps = (name) => console.log(name);
  await page.goto(address);
  assert.ok(!page.url().includes(token), "the token stays in the address");
  await folderToResult(page, steps);
  await excludeAndUndo(page, steps);
  await editorBesideThePage(page, steps);
  await inSpace(page, steps);
  await suggestCompareExport(page, steps);
  await page.close();
  assert.deepEqual(problems, []);
  address = await killedServer(browser, steps);
  await otherOrigins(browser, address, steps);
} catch (error) {
  failed = true;
  console.error(error);
  console.error(problems.join("\n"));
} finally {
  await browser.close();
  server?.kill("SIGTERM");
  rmSync(folder, { recursive: true, force: true });
}
if (!failed && existsSync(folder)) console.error("the folder was not removed");
process.exit(failed ? 1 : 0);
