// SPDX-License-Identifier: Apache-2.0
// A workbench on a folder, Debian's Chromium, and what is wrong on any page. Command line of each test:
//
//   node TEST.mjs PROGRAM SOURCE NODE_MODULES [SCREENSHOTS]
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { existsSync, readFileSync, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";

export const [program, source, modules, screenshots] = process.argv.slice(2).map((path) => resolve(path));
export const { chromium } = createRequire(join(modules, "/"))("playwright-core");
export const kChromium = "/usr/bin/chromium";
export const kPatience = 60_000; // ms, of a busy machine
if (!existsSync(kChromium)) {
  console.log(`skipped: ${kChromium} is missing (Debian package chromium)`);
  process.exit(77);
}

export const openBrowser = (args = []) => chromium.launch({ executablePath: kChromium, args: ["--no-sandbox", ...args] });

/** Process, printed address and its token. */
export async function startServer(folder) {
  const server = spawn(program, ["workbench", folder, "--no-open"]);
  let out = "";
  server.stdout.on("data", (data) => (out += data));
  for (let i = 0; i < 600 && !out.includes("\n"); ++i) await new Promise((done) => setTimeout(done, 50));
  const address = out.split("\n")[0];
  return { process: server, address, token: address.split("token=")[1] };
}

/** Waits until `holds()` is true. */
export async function until(holds) {
  for (let i = 0; !(await holds()); ++i) {
    assert.ok(i < kPatience / 50, `never: ${holds}`);
    await new Promise((done) => setTimeout(done, 50));
  }
}

/** What went wrong on the pages so far. */
export const problems = [];

/** Collects errors of a page, refused requests, and those that leave this machine or hold the token. */
export function watch(page, server) {
  page.on("console", (line) => line.type() === "error" && problems.push(line.text()));
  page.on("pageerror", (error) => problems.push(String(error)));
  page.on("response", (answer) => answer.status() >= 400 && problems.push(`${answer.status()} ${answer.url()}`));
  page.on("request", (request) => {
    const url = new URL(request.url());
    if (url.protocol === "http:" && url.hostname !== "127.0.0.1") problems.push(`left this machine: ${url}`);
    if (url.href.includes(server.token)) problems.push(`the token in an address: ${url}`);
  });
}

/** A bar of one of the page's charts, the first: a camera's frames; what the page names with the pointer on it, and a click there. */
export async function barOf(page, index, chart = 0) {
  const bars = page.locator("[data-bars]").nth(chart);
  await bars.locator(".u-over").waitFor({ timeout: kPatience });
  await bars.scrollIntoViewIfNeeded();
  const count = Number(await bars.getAttribute("data-bars"));
  const box = await bars.locator(".u-over").boundingBox();
  const at = [box.x + ((index + 0.5) / count) * box.width, box.y + box.height / 2];
  await page.mouse.move(...at);
  const words = (await bars.locator(".tip").textContent()) ?? "";
  return { count, name: words.split(":")[0], words, click: () => page.mouse.click(...at) };
}

const axe = readFileSync(join(modules, "axe-core/axe.min.js"), "utf8");

/** No violation of WCAG 2.2 AA that axe finds, and no sideways scrolling, in both widths and both themes; pictures for the eye. */
export async function look(page, name) {
  const size = page.viewportSize();
  for (const [width, scheme] of [[1400, "light"], [1400, "dark"], [390, "light"], [390, "dark"]]) {
    await page.setViewportSize({ width, height: 900 });
    await page.emulateMedia({ colorScheme: scheme });
    await page.waitForTimeout(300);
    if (screenshots) {
      await page.screenshot({ path: join(screenshots, `${name}_${width}_${scheme}.png`), fullPage: true });
    }
    const wide = await page.evaluate(() => {
      if (document.documentElement.scrollWidth <= innerWidth) return [];
      const all = [...document.querySelectorAll("body *")];
      return all.filter((each) => each.getBoundingClientRect().right > innerWidth).map((each) => each.outerHTML.slice(0, 300));
    });
    assert.deepEqual(wide, [], `${name} is wider than ${width} px`);
    await page.evaluate(axe);
    const { violations } = await page.evaluate(() =>
      axe.run({ runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"] }),
    );
    const found = violations.map(({ id, help, nodes }) => `${id}: ${help}: ${nodes.map((node) => node.html).join(" ")}`);
    assert.deepEqual(found, [], `${name} at ${width} px, ${scheme}`);
  }
  await page.setViewportSize(size);
  await page.emulateMedia({ colorScheme: "light" });
}

/** Runs a test in a browser: work(browser, steps) fails by what it throws or what is left in `problems`. Removes `folder`; ends the program. */
export async function test(folder, browserArguments, work) {
  let failed = false;
  const browser = await openBrowser(browserArguments);
  try {
    await work(browser, (name) => console.log(name));
    assert.deepEqual(problems, []);
  } catch (error) {
    failed = true;
    console.error(error);
    console.error(problems.join("\n"));
    for (const page of browser.contexts().flatMap((context) => context.pages())) {
      console.error(page.url(), await page.locator("body").innerText());
    }
  } finally {
    await browser.close();
    if (!process.env.KEEP) rmSync(folder, { recursive: true, force: true });
  }
  process.exit(failed ? 1 : 0);
}

/** The same with the page of a workbench on `root`: work(page, steps, server). */
export function testPage({ folder, root = folder, height = 900, browserArguments = [] }, work) {
  return test(folder, browserArguments, async (browser, steps) => {
    const server = await startServer(root);
    try {
      const page = await browser.newPage({ viewport: { width: 1400, height } });
      watch(page, server);
      await page.goto(server.address);
      await work(page, steps, server);
    } finally {
      server.process.kill("SIGTERM");
    }
  });
}
