// SPDX-License-Identifier: Apache-2.0
// Opens each page of the built site in Chromium, wide and narrow, light and dark. Fails for errors on the console, requests that
// fail or leave this machine, a first paint after a second, and sideways scrolling; leaves pictures for the eye.
//
//   node look.mjs SITE NODE_MODULES PICTURES [PART_OF_NAME]
import { createServer } from "node:http";
import { mkdirSync, readdirSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join, relative, resolve } from "node:path";

const [site, modules, pictures] = process.argv.slice(2, 5).map((path) => resolve(path));
const { chromium } = createRequire(join(modules, "/"))("playwright-core");
const kTypes = { html: "text/html", css: "text/css", js: "text/javascript", json: "application/json", svg: "image/svg+xml" };
const root = dirname(site); // versions.json stands beside the versions
const server = createServer((request, answer) => {
  try {
    const path = decodeURIComponent(request.url.split("?")[0]);
    const body = readFileSync(join(root, path));
    answer.writeHead(200, { "content-type": kTypes[path.split(".").pop()] ?? "application/octet-stream" }).end(body);
  } catch {
    answer.writeHead(404).end();
  }
}).listen(0, "127.0.0.1");
await new Promise((done) => server.once("listening", done));
const address = `http://127.0.0.1:${server.address().port}/`;

const pages = readdirSync(site, { recursive: true }).filter((name) => name.endsWith(".html") && name !== "404.html" && name.includes(process.argv[5] ?? ""));
const problems = [];
const paints = [];
const browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args: ["--no-sandbox"] });
mkdirSync(pictures, { recursive: true });
for (const [width, colorScheme] of [[1400, "light"], [1400, "dark"], [390, "light"], [390, "dark"]]) {
  const context = await browser.newContext({ viewport: { width, height: 900 }, colorScheme });
  for (const name of pages.sort()) {
    const page = await context.newPage();
    const problem = (text) => problems.push(`${name} (${width}, ${colorScheme}): ${text}`);
    page.on("console", (line) => line.type() === "error" && problem(line.text()));
    page.on("pageerror", (error) => problem(String(error)));
    page.on("response", (response) => response.status() >= 400 && problem(`${response.status()} ${response.url()}`));
    page.on("request", (request) => request.url().startsWith(address) || request.url().startsWith("data:") || problem(`left this machine: ${request.url()}`));
    let paint = Infinity;
    for (let i = 0; i < 3 && paint > 1000; ++i) {  // other work of the machine may delay one
      await page.goto(address + relative(root, join(site, name)));
      await page.waitForTimeout(150);
      paint = Math.min(paint, await page.evaluate(() => performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? 0));
    }
    const scroll = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    paints.push([paint, name]);
    if (paint > 1000) problem(`first paint after ${paint.toFixed(0)} ms`);
    if (scroll > 0) problem(`${scroll} px wider than the window`);
    await page.screenshot({ path: join(pictures, `${name.replaceAll("/", "_")}_${width}_${colorScheme}.png`) });
    await page.close();
  }
}
await browser.close();
server.close();
paints.sort(([a], [b]) => b - a);
console.log(`${pages.length} pages in 4 views, first paint ${paints[paints.length >> 1][0].toFixed(0)} ms (median), ${paints[0][0].toFixed(0)} ms (last: ${paints[0][1]})`);
if (problems.length) {
  console.error([...new Set(problems)].join("\n"));
  process.exit(1);
}
