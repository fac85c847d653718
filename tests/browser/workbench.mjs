// SPDX-License-Identifier: Apache-2.0
// The workbench in a real browser: from a folder of images to an export, exclude and undo, and what
// pages of other origins must not reach.
//
//   node workbench.mjs PROGRAM IMAGES NODE_MODULES [SCREENSHOTS]
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { cpSync, mkdirSync, mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { barOf, chromium, kChromium, kPatience, look, problems, program, source as images, startServer, test, until, watch } from "./harness.mjs";

const folder = mkdtempSync(join(tmpdir(), "plenocal-workbench-"));
mkdirSync(join(folder, "left"));
for (const name of readdirSync(images)) {
  if (/^left\d+\.jpg$/.test(name)) cpSync(join(images, name), join(folder, "left", name));
}

const text = (name) => readFileSync(join(folder, name), "utf8");

async function folderToResult(page, steps) {
  steps("a session is proposed; what is missing is said in plain words");
  await page.getByRole("button", { name: "Propose a session" }).click();
  await page.getByText("Measure the side of a square").waitFor({ timeout: kPatience });
  assert.equal(await page.locator(".problem").count(), 0);
  await look(page, "missing");

  steps("fields change the text, comments stay; the text changes the fields");
  const before = text("target.yaml");
  const [field, unit] = [page.getByRole("textbox", { name: "square", exact: true }), page.getByLabel("unit of square")];
  await field.fill("25");
  await field.press("Tab");
  await page.getByText("left: 13 images").waitFor({ timeout: kPatience });
  assert.equal(text("target.yaml"), before.replace(/^square:/m, "square: 25 mm"));
  const target = page.getByRole("textbox", { name: /^Target/ });
  await target.fill((await target.inputValue()).replace(/^square:.*$/m, "square: 2.5 cm\ntolerance: 0.5 mm"));
  await until(() => field.isDisabled());
  await page.locator("section", { has: target }).getByRole("button", { name: "Save" }).click();
  await until(async () => (await unit.inputValue()) === "cm");
  assert.equal(await field.inputValue(), "2.5");
  await unit.selectOption("mm");
  await until(() => /^square: 2.5 mm$/m.test(text("target.yaml")));
  await field.fill("25");
  await field.press("Enter");
  await until(() => /^square: 25 mm$/m.test(text("target.yaml")));
  const model = page.getByLabel("left: model");
  await model.selectOption("fov");
  await until(() => /model: fov  # chosen/.test(text("session.yaml")));
  await page.getByRole("button", { name: "Undo" }).click();
  await until(async () => (await model.inputValue()) === "auto");

  steps("text and file changed at once: nothing is lost");
  const session = page.getByRole("textbox", { name: "Session" });
  const old = await session.inputValue();
  assert.equal(old, text("session.yaml"), "the text follows at once with the fields");
  await session.fill(`${old}# mine\n`);
  writeFileSync(join(folder, "session.yaml"), `${old}# theirs\n`);
  await page.getByText("The file has changed meanwhile").waitFor({ timeout: kPatience });
  await page.getByRole("button", { name: "Take the new text" }).click();
  assert.equal(await session.inputValue(), `${old}# theirs\n`);
  writeFileSync(join(folder, "session.yaml"), old);
  await until(async () => (await session.inputValue()) === old);
  await look(page, "setup");

  steps("calibration, with the detections on the way");
  await page.getByRole("button", { name: "Calibrate", exact: true }).click();
  await page.locator("main[data-view=results][data-run='1']").waitFor({ timeout: kPatience });
  await page.getByRole("button", { name: "Images", exact: true }).click();
  await page.getByText("13 images looked at, target found in 13").waitFor({ timeout: kPatience });
  await page.locator(".thumb img").first().waitFor({ timeout: kPatience });
  await look(page, "images");

  steps("the page has the numbers of the files, and these are those of the command line");
  await page.getByRole("button", { name: "Results", exact: true }).click();
  await page.locator("table").first().waitFor({ timeout: kPatience });
  execFileSync(program, ["calibrate", "session.yaml", "-o", "by_hand", "--quiet"], { cwd: folder });
  const parameters = /parameters: \{(.*)\}/.exec(text("by_hand/calibration.yaml"))[1];
  assert.equal(/parameters: \{(.*)\}/.exec(text("runs/1/calibration.yaml"))[1], parameters);
  for (const [, name, value] of parameters.matchAll(/(\w+): ([-\d.e]+)/g)) {
    const cell = page.locator("tr", { has: page.getByRole("rowheader", { name, exact: true }) }).locator("td").first();
    const [exact, sigma] = await Promise.all(["data-value", "data-sigma"].map(async (key) => Number(await cell.getAttribute(key))));
    assert.equal(exact, Number(value));
    assert.ok(Math.abs(parseFloat(await cell.innerText()) - exact) < 0.1 * sigma, `digits of ${name}`);
  }
}

async function addImages(page, steps) {
  steps("images are added to a camera of the session, also while a job runs; one of the same name is refused");
  const added = join(folder, "new.pgm");
  writeFileSync(added, Buffer.concat([Buffer.from("P5 640 480 255\n"), Buffer.alloc(640 * 480, 128)]));
  await page.getByRole("button", { name: "Set up", exact: true }).click();
  await page.getByRole("button", { name: "Detect only" }).click();
  await page.getByRole("button", { name: "Images", exact: true }).click();
  const input = page.getByLabel("images or recordings");
  await input.setInputFiles([added, join(images, "left01.jpg")]);
  await page.getByText("1 of 2 files are in the folder").waitFor({ timeout: kPatience });
  await page.getByText("left/left01.jpg: is there already").waitFor();
  await page.getByRole("heading", { name: "left: 14 images" }).waitFor({ timeout: kPatience });
  await look(page, "added");
  assert.deepEqual(readFileSync(join(folder, "left/new.pgm")), readFileSync(added));
  assert.deepEqual(problems.splice(0).filter((line) => !/400/.test(line)), []);
  await page.locator("footer [data-job=done]").waitFor({ timeout: kPatience });

  steps("an image without the target is shown with the reason");
  await page.getByRole("button", { name: "Set up", exact: true }).click();
  await page.getByRole("button", { name: "Detect only" }).click();
  await page.getByRole("button", { name: "Images", exact: true }).click();
  await page.getByText("14 images looked at, target found in 13").waitFor({ timeout: kPatience });
  await page.getByRole("button", { name: "left new" }).click();
  await page.locator("[data-shown='left/new'] canvas[data-loaded=yes]").waitFor({ timeout: kPatience });
  assert.ok((await page.locator("[data-shown] p.problem").textContent()).length > 5);
  await look(page, "refused");
  await page.getByRole("button", { name: "all images" }).click();
  rmSync(join(folder, "left/new.pgm"));
  await page.getByRole("button", { name: "Results", exact: true }).click();
}

async function excludeAndUndo(page, steps) {
  steps("the worst bar leads to its image with all corners");
  const rms = ({ words }) => Number(/: ([\d.]+) px/.exec(words)[1]);
  let worst = await barOf(page, 0);
  for (let i = 1; i < worst.count; ++i) {
    const bar = await barOf(page, i);
    if (rms(bar) > rms(worst)) worst = bar;
  }
  await worst.click();
  const frame = worst.name;
  await page.locator("canvas[data-points='54'][data-loaded=yes]").waitFor({ timeout: kPatience });
  assert.match(page.url(), new RegExp(`#/results/left/${frame}`));
  await page.getByLabel("order").selectOption("influence");
  while (!(await barOf(page, 0)).words.includes("without it left.")) await page.waitForTimeout(100);
  await look(page, "results");
  await page.getByLabel("order").selectOption("name");
  await page.reload();
  await page.locator("canvas[data-points='54']").waitFor({ timeout: kPatience });
  await page.getByRole("heading", { name: `left / ${frame}` }).waitFor();

  steps("arrow keys on the bars choose the frames beside");
  const bars = page.locator("[data-bars] [role=slider]").first();
  await bars.focus();
  await page.keyboard.press("ArrowLeft");
  await page.locator(`[data-bars]:not([data-chosen='${frame}'])[data-chosen]`).waitFor({ timeout: kPatience });
  const beside = await page.locator("[data-bars]").first().getAttribute("data-chosen");
  await page.getByRole("heading", { name: `left / ${beside}` }).waitFor();
  await page.keyboard.press("ArrowRight");
  await page.getByRole("heading", { name: `left / ${frame}` }).waitFor();

  steps("a drag over bars chooses frames to step through, a double click all of them");
  const over = page.locator("[data-bars] .u-over").first();
  const names = [];
  for (let i = 0; i < 6; ++i) names.push((await barOf(page, i)).name);
  const box = await over.boundingBox();
  const middle = (index) => box.x + ((index + 0.5) / worst.count) * box.width;
  await page.mouse.move(middle(2), box.y + 20);
  await page.mouse.down();
  await page.mouse.move(middle(4), box.y + 20, { steps: 4 });
  await page.mouse.up();
  await page.locator("[data-bars][data-part='3']").waitFor({ timeout: kPatience });
  await page.getByRole("heading", { name: `left / ${names[2]}` }).waitFor();
  await page.mouse.click(5, 500);
  for (const key of ["ArrowLeft", "ArrowRight", "ArrowRight", "ArrowRight"]) await page.keyboard.press(key);
  await page.getByRole("heading", { name: `left / ${names[4]}` }).waitFor();
  await page.locator("[data-step='3 of 3']").waitFor();
  await look(page, "chosen");
  await over.dblclick();
  await page.locator("[data-step$='of 13']").waitFor({ timeout: kPatience });

  steps("the image stays beside the plots; a map has a scale of its own");
  const map = page.locator("figure", { hasText: "m away" }).first();
  await page.getByRole("button", { name: "own scale" }).first().click();
  await map.getByText("0.001 px").waitFor({ state: "detached" });
  await page.evaluate(() => scrollTo(0, document.body.scrollHeight));
  const plane = await page.locator(".plane canvas").boundingBox();
  assert.ok(plane.y >= 0 && plane.y + plane.height < 900, `the image is at ${JSON.stringify(plane)}`);
  await page.evaluate(() => scrollTo(0, 0));
  await page.getByRole("button", { name: "own scale" }).first().click();
  await page.evaluate((name) => (location.hash = `#/look/left/${name}`), frame);
  await page.getByRole("heading", { name: `left / ${frame}` }).waitFor();

  steps("x excludes it, nothing else in the text changes, Ctrl+Z takes it back");
  const before = text("session.yaml");
  await page.keyboard.press("x");
  await page.getByRole("button", { name: "Include again" }).waitFor({ timeout: kPatience });
  assert.equal(text("session.yaml"), `${before}exclude:\n  - {camera: left, frame: ${frame}}\n`);
  await page.locator("[data-excluded='1']").waitFor();
  await page.keyboard.press("Control+z");
  await page.getByRole("button", { name: "Exclude (x)" }).waitFor({ timeout: kPatience });
  assert.equal(text("session.yaml"), before);
  await page.keyboard.press("Control+Shift+z");
  await page.getByRole("button", { name: "Include again" }).waitFor({ timeout: kPatience });

  steps("what the result would be without it is shown, then the next run is made, and compared with the one before");
  const preview = page.locator("[data-preview]");
  await preview.waitFor({ timeout: kPatience });
  const [, predicted] = /RMS [\d.]+ → ([\d.]+) px, sigma of the projection/.exec(await preview.textContent());
  await page.keyboard.press("c");
  await page.locator("main[data-view=results][data-run='2']").waitFor({ timeout: kPatience });
  const made = Number(/rms: ([\d.]+)/.exec(text("runs/2/calibration.yaml"))[1]);
  assert.ok(Math.abs(Number(predicted) - made) < 0.005, `${predicted} px predicted, ${made} px made`);
  await preview.waitFor({ state: "detached", timeout: kPatience });
  assert.ok(!text("runs/2/residuals.csv").includes(`left,${frame},`));
  await page.getByText(/Against run 1/).waitFor({ timeout: kPatience });
  assert.equal(await page.locator("[data-excluded='1']").getAttribute("data-chosen"), frame, "the excluded frame can be chosen");
}

async function choosePoints(page, steps) {
  steps("a click names a point; a line around points leaves them out of the next run");
  const frame = "left03";
  const rowsOf = (run) => {
    const [head, ...rows] = text(`runs/${run}/residuals.csv`).trim().split("\n").map((line) => line.split(","));
    const column = (row, name) => row[head.indexOf(name)];
    return rows
      .filter((row) => column(row, "camera") === "left" && column(row, "frame") === frame)
      .map((row) => ({ marker: Number(column(row, "marker")), x: Number(column(row, "x")), y: Number(column(row, "y")) }));
  };
  await page.evaluate((name) => (location.hash = `#/look/left/${name}?run=2`), frame);
  await page.getByRole("heading", { name: `left / ${frame}` }).waitFor({ timeout: kPatience });
  const canvas = page.locator("canvas[data-points='54'][data-loaded=yes]");
  await canvas.waitFor({ timeout: kPatience });
  await canvas.scrollIntoViewIfNeeded();
  const box = await canvas.boundingBox();
  const scale = box.width / 640;
  const at = (x, y) => [box.x + scale * (x + 0.5), box.y + scale * (y + 0.5)];
  const points = rowsOf(2);
  await page.mouse.click(...at(points[20].x, points[20].y));
  await page.getByText(`point ${points[20].marker} at (${points[20].x.toFixed(2)}, ${points[20].y.toFixed(2)})`).waitFor();

  const middle = [...points].sort((a, b) => a.x - b.x)[27].x;
  const inside = points.filter((point) => point.x < middle && Math.abs(point.x - middle) > 1).map((point) => point.marker).sort((a, b) => a - b);
  await page.keyboard.down("Shift");
  await page.mouse.move(...at(2, 2));
  await page.mouse.down();
  for (const [x, y] of [[middle - 0.5, 2], [middle - 0.5, 477], [2, 477]]) await page.mouse.move(...at(x, y), { steps: 4 });
  await page.mouse.up();
  await page.keyboard.up("Shift");
  await page.getByRole("button", { name: `Exclude ${inside.length} points (x)` }).waitFor();
  await look(page, "points");
  const before = text("session.yaml");
  await page.keyboard.press("x");
  await page.getByText(`excluded: points ${inside.join(", ")}`).waitFor({ timeout: kPatience });
  assert.ok(text("session.yaml").endsWith(`  - {camera: left, frame: ${frame}, markers: [${inside.join(", ")}]}\n`));
  await page.keyboard.press("c");
  await page.locator("main[data-view=results][data-run='3']").waitFor({ timeout: kPatience });
  assert.deepEqual(new Set(rowsOf(3).map((point) => point.marker)), new Set(points.map((point) => point.marker).filter((marker) => !inside.includes(marker))));
  await page.getByRole("button", { name: "Include again" }).click();
  await page.getByText(/excluded: points/).waitFor({ state: "detached", timeout: kPatience });
  assert.equal(text("session.yaml"), before);
}

async function markersAndField(page, steps) {
  steps("the bar of a marker leads to the image with its largest residual, the marker chosen");
  const bar = await barOf(page, 10, 1);
  assert.equal(bar.count, 54);
  await bar.click();
  await page.getByText(new RegExp(`^point ${bar.name} at `)).waitFor({ timeout: kPatience });
  await page.locator("figure", { hasText: "Residuals over the image" }).locator(".u-over").waitFor();
}

async function editorBesideThePage(page, steps) {
  steps("a change by an editor shows, a wrong one with its line");
  await page.getByRole("button", { name: "Set up", exact: true }).click();
  const good = text("session.yaml");
  await page.locator("img.target").waitFor({ timeout: kPatience });
  writeFileSync(join(folder, "session.yaml"), good.replace("model: auto", "model: pinhole-radtam"));
  await page.getByText(/session.yaml:\d+.*pinhole-radtam/).first().waitFor({ timeout: kPatience });
  writeFileSync(join(folder, "session.yaml"), good);
  await page.getByText("left: 13 images").waitFor({ timeout: kPatience });
}

async function inSpace(page, steps) {
  steps("cameras in space: hover names one, a click opens its image");
  await page.getByRole("button", { name: "Space", exact: true }).click();
  const canvas = page.locator("canvas[data-cameras='12']");
  await canvas.waitFor({ timeout: kPatience });
  await page.getByRole("button", { name: "suggested poses" }).click();
  await page.locator("[data-ghosts='5']").waitFor({ timeout: kPatience });
  await page.getByLabel("displacement").selectOption("100");
  await look(page, "space");
  const scale = () => canvas.getAttribute("data-scale");
  const before = await scale();
  assert.match(before, /^\d+ (m|mm)$/);
  for (let i = 0; i < 4; ++i) await page.getByRole("button", { name: "nearer" }).click();
  await until(async () => (await scale()) !== before);
  await page.getByRole("button", { name: "names" }).click();
  await page.getByRole("button", { name: "front" }).click();
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
  await look(page, "next");
  await page.getByRole("button", { name: "Compare", exact: true }).first().click();
  await page.locator("main").getByRole("button", { name: "Compare", exact: true }).click();
  await page.locator("main pre").waitFor({ timeout: kPatience });
  await page.locator("figure", { hasText: "left, far away" }).locator(".u-over").waitFor({ timeout: kPatience });
  await look(page, "compare");
  await page.getByRole("button", { name: "Export", exact: true }).first().click();
  await page.locator("main").getByRole("button", { name: "Export", exact: true }).click();
  await page.locator("main pre").waitFor({ timeout: kPatience });
  await look(page, "export");
  execFileSync(program, ["export", "runs/3/calibration.yaml", "--format", "opencv", "-o", "by_hand.yml"], { cwd: folder });
  assert.equal((await page.locator("main pre").textContent()).trim(), text("by_hand.yml").trim());
  await page.getByText(/plenocal export .*--format opencv/).first().waitFor();
}

async function killedServer(browser, steps) {
  steps("a killed server loses nothing");
  server.process.kill("SIGKILL");
  await new Promise((done) => server.process.once("exit", done));
  server = await startServer(folder);
  const page = await browser.newPage();
  watch(page, server);
  await page.goto(server.address);
  await page.getByRole("button", { name: "Results", exact: true }).click();
  await page.locator("main[data-run='3']").waitFor({ timeout: kPatience });
  assert.ok(!page.url().includes("token"));
  await page.getByRole("button", { name: "Set up", exact: true }).click();
  assert.equal(await page.getByRole("button", { name: "Undo" }).isEnabled(), true);
  await page.close();
}

// What another page in the same browser may try.
async function otherOrigins(browser, steps) {
  steps("pages of other origins get nothing and change nothing");
  const base = server.address.split("/#")[0];
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

let server = await startServer(folder);
await test(folder, [], async (browser, steps) => {
  try {
    const page = await browser.newPage({ viewport: { width: 1400, height: 900 } });
    watch(page, server);
    await page.goto(server.address);
    assert.ok(!page.url().includes(server.token), "the token stays in the address");
    await folderToResult(page, steps);
    await addImages(page, steps);
    await excludeAndUndo(page, steps);
    await choosePoints(page, steps);
    await markersAndField(page, steps);
    await editorBesideThePage(page, steps);
    await inSpace(page, steps);
    await suggestCompareExport(page, steps);
    await page.close();
    assert.deepEqual(problems, []);
    await killedServer(browser, steps);
    await otherOrigins(browser, steps);
    // What others tried was refused.
    problems.splice(0);
  } finally {
    server.process.kill("SIGTERM");
  }
});
