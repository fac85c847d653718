// SPDX-License-Identifier: Apache-2.0
// report.html and try.html as files, without a network: with script and without, by pointer and keys, on paper.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { look, problems, program, source, test } from "./harness.mjs";

const folder = mkdtempSync(join(tmpdir(), "plenocal-report-"));
const input = [join(source, "left*.jpg"), "--target", "chessboard:9x6:25mm"];
const run = (...words) => execFileSync(program, [...words, "--quiet"], { cwd: folder });
run("calibrate", ...input, "-o", "out");
run("try", "out/session.yaml", "-o", "tried", "--models", "pinhole-radial3", "pinhole-radtan");
const address = (name) => `file://${join(folder, name)}`;

async function open(browser, name, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1400, height: 900 }, offline: true, ...options });
  const page = await context.newPage();
  page.on("console", (line) => problems.push(line.text()));
  page.on("pageerror", (error) => problems.push(String(error)));
  page.on("request", (request) => /^(file|data):/.test(request.url()) || problems.push(`left the file: ${request.url()}`));
  await page.goto(address(name));
  return page;
}

/** Cells of the tables of parameters and residuals. */
const numbersOf = (page) => page.locator("table").filter({ hasText: /value|reprojection/ }).locator("td, th[scope=row]").allInnerTexts();

async function bothModes(browser, steps) {
  steps("without script: verdict, parameters and residuals, the same numbers as with it");
  const plain = await open(browser, "out/report.html", { javaScriptEnabled: false });
  const page = await open(browser, "out/report.html");
  const grade = /grade: (\w+)/.exec(readFileSync(join(folder, "out/calibration.yaml"), "utf8"))[1];
  for (const each of [plain, page]) await each.locator(`.verdict.${grade}`).getByText(`${grade}: `).waitFor();
  assert.equal(await plain.locator("canvas").count(), 0);
  const numbers = await numbersOf(page);
  assert.ok(numbers.length > 20, `${numbers.length} cells`);
  assert.deepEqual(await numbersOf(plain), numbers);
  const findings = (each) => each.locator(".findings li").allInnerTexts();
  assert.deepEqual((await findings(plain)).map((text) => text.replace(/\s+/g, " ")), (await findings(page)).map((text) => text.replace(/\s+/g, " ")));
  await plain.context().close();
  return page;
}

async function readTheFigures(page, steps) {
  steps("figures are drawn when they come near; pointer and arrow keys name a frame");
  const drawn = () => page.locator(".u-wrap").count();
  const all = await page.locator(".chart").count();
  assert.ok((await drawn()) < all, "all figures are drawn at once");
  const bars = page.getByRole("slider", { name: "Per frame" });
  await bars.scrollIntoViewIfNeeded();
  await bars.locator(".u-over").hover();
  await bars.getByText(/^(left)?\d\d: [\d.]+ px, 54 points/).waitFor();
  await page.mouse.move(0, 0);
  await bars.focus();
  const chosen = () => page.locator("[data-bars]").first().getAttribute("data-chosen");
  const worst = await chosen();
  for (const key of ["ArrowLeft", "ArrowRight"]) {
    await page.keyboard.press(key);
    await bars.getByText(new RegExp(`^${await chosen()}: `)).waitFor();
    assert.equal((await chosen()) === worst, key === "ArrowRight");
  }

  steps("a click on a bar leads to its frame; the worst ones are drawn with their residuals");
  const frames = page.locator("figure", { hasText: /, frame \w+RMS/ });
  assert.equal(await frames.count(), 4);
  const box = await bars.locator(".u-over").boundingBox();
  await page.mouse.click(box.x + 0.5 * box.width, box.y + 0.5 * box.height);
  await frames.first().getByText(`, frame ${await chosen()}`).waitFor();
  await frames.first().locator(".u-over").hover({ position: { x: 100, y: 100 } });
  assert.match(await page.title(), /^Calibration of out, \d{4}-\d\d-\d\d$|^Calibration of plenocal-report-\w+, \d{4}-\d\d-\d\d$/);
  await page.evaluate(() => window.plenocalReport.drawAll());
  assert.equal(await drawn(), all);
}

async function inSpace(page, steps) {
  steps("in space: a frame stands out, names under the pointer, keys turn");
  const canvas = page.locator("canvas.space");
  await canvas.scrollIntoViewIfNeeded();
  const picture = () => canvas.evaluate((element) => element.toDataURL());
  const before = await picture();
  await canvas.focus();
  await page.keyboard.press("ArrowLeft");
  await page.waitForTimeout(400);
  assert.notEqual(await picture(), before);
  await page.getByLabel("frame", { exact: true }).fill("3");
  await page.locator("[data-hover]").getByText(/^(left)?04$/).waitFor();
}

async function onPaper(page, steps) {
  steps("paper is light");
  await page.emulateMedia({ colorScheme: "dark" });
  const back = () => page.evaluate(() => getComputedStyle(document.documentElement).getPropertyValue("--back").trim());
  assert.notEqual(await back(), "#ffffff");
  await page.evaluate(() => dispatchEvent(new Event("beforeprint")));
  assert.equal(await back(), "#ffffff");
  await page.evaluate(() => dispatchEvent(new Event("afterprint")));
  assert.notEqual(await back(), "#ffffff");
  assert.ok((await page.pdf({ format: "A4" })).length > 100_000);
}

await test(folder, [], async (browser, steps) => {
  const page = await bothModes(browser, steps);
  await readTheFigures(page, steps);
  await inSpace(page, steps);
  await look(page, "report");
  await onPaper(page, steps);
  steps("the page of `try`");
  await look(await open(browser, "tried/try.html"), "try");
});
