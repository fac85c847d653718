// SPDX-License-Identifier: Apache-2.0
// From an empty folder to a calibration with a camera that the page opens. Chromium shows a video in its place: chessboards, each for a while.
//
//   node camera.mjs PROGRAM IMAGES NODE_MODULES [SCREENSHOTS]
import assert from "node:assert/strict";
import { mkdirSync, mkdtempSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { kPatience, look, openBrowser, source as images, testPage } from "./harness.mjs";

// Chromium names the camera by the video's path; names of cameras can be long.
const base = mkdtempSync(join(tmpdir(), "plenocal-camera-with-a-name-that-is-wider-than-a-telephone-"));
const folder = join(base, "project");
mkdirSync(folder);
const video = join(base, "camera.y4m");
const left = readdirSync(images).filter((name) => /^left\d+\.jpg$/.test(name)).map((name) => join(images, name));
const kPerSecond = 5;
const kSeconds = 2; // each view
const kWaits = 90_000; // ms: the views come in turn, whatever the machine does

/** The images as a video without compression, gray. */
async function writeVideo() {
  const browser = await openBrowser();
  const page = await browser.newPage();
  const views = [];
  for (const path of left) {
    const url = `data:image/jpeg;base64,${readFileSync(path).toString("base64")}`;
    const { width, height, gray } = await page.evaluate(async (from) => {
      const image = new Image();
      image.src = from;
      await image.decode();
      const canvas = new OffscreenCanvas(image.width, image.height);
      canvas.getContext("2d").drawImage(image, 0, 0);
      const { data } = canvas.getContext("2d").getImageData(0, 0, image.width, image.height);
      let text = "";
      for (let i = 0; i < data.length; i += 4) text += String.fromCharCode(16 + Math.round((data[i + 1] * 219) / 255));
      return { width: image.width, height: image.height, gray: btoa(text) };
    }, url);
    const colour = Buffer.alloc((width / 2) * (height / 2) * 2, 128);
    const frame = Buffer.concat([Buffer.from("FRAME\n"), Buffer.from(gray, "base64"), colour]);
    if (views.length === 0) views.push(Buffer.from(`YUV4MPEG2 W${width} H${height} F${kPerSecond}:1 Ip A1:1 C420jpeg\n`));
    for (let i = 0; i < kPerSecond * kSeconds; ++i) views.push(frame);
  }
  await browser.close();
  writeFileSync(video, Buffer.concat(views));
}

async function record(page, steps) {
  // `waitForFunction` needs what the page's policy forbids.
  const reaches = async (attribute, least) => {
    for (const end = Date.now() + kWaits; Date.now() < end; await page.waitForTimeout(100)) {
      const element = page.locator(`[${attribute}]`);
      if ((await element.count()) > 0 && Number(await element.getAttribute(attribute)) >= least) return;
    }
    assert.fail(`${attribute} does not reach ${least}`);
  };
  const automatic = page.getByLabel("whenever the view is new and stands still");
  const files = () => readdirSync(join(folder, "camera"));

  steps("a camera is opened in an empty folder, and takes pictures by itself");
  await page.getByRole("button", { name: "Open a camera" }).click();
  await page.getByText("640 x 480 px").waitFor({ timeout: kPatience });
  await automatic.check();
  await reaches("data-taken", 4);
  await automatic.uncheck();
  await look(page, "camera");
  const first = readFileSync(join(folder, "camera", files()[0]));
  assert.equal(first.readUInt32BE(16), 640);
  assert.equal(first.readUInt32BE(20), 480);

  steps("they give a session, and the first calibration");
  await page.getByText(/camera: \d+ images/).waitFor({ timeout: kPatience });
  await page.getByRole("button", { name: "Propose a session" }).click();
  const target = page.getByRole("textbox", { name: /^Target/ });
  await target.waitFor({ timeout: kPatience });
  await target.fill((await target.inputValue()).replace(/^square:.*$/m, "square: 25 mm"));
  await page.locator("section", { has: target }).getByRole("button", { name: "Save" }).click();
  await page.getByRole("button", { name: "Next views" }).click();
  await page.getByRole("button", { name: "Watch the folders" }).click();
  await page.locator(".suggestions li").first().waitFor({ timeout: kWaits });

  steps("the first suggestion lies over the live image, and each further picture is in the next result");
  const before = files().length;
  await page.getByRole("button", { name: "Open a camera" }).click();
  await page.locator(".live polygon").first().waitFor({ timeout: kPatience });
  // Views like those so far add a few per cent, and are not kept.
  const kLeast = 15; // per cent
  await page.getByLabel("adds at least").fill(String(kLeast));
  await automatic.check();
  await reaches("data-share", 0.001);
  await reaches("data-frames", before + 1);
  await reaches("data-renewed", 0.001);
  await automatic.uncheck();
  const kept = files().length - before;
  assert.ok(kept <= 3, `${kept} views of 13 kept`);
  await look(page, "camera_live");
  const count = Number(await page.locator("[data-taken]").getAttribute("data-taken"));
  await page.getByRole("button", { name: "Take a picture" }).click();
  await reaches("data-taken", count + 1);
  const after = files().length;
  await reaches("data-frames", after);
  const calibration = readFileSync(join(folder, "runs/1/calibration.yaml"), "utf8");
  const f = Number(/f_x: ([\d.]+)/.exec(calibration)[1]);
  assert.ok(Math.abs(f - 536) < 30, `f_x is ${f}`); // of all images 536

  steps("what closes the camera");
  await page.getByRole("button", { name: "Close" }).click();
  assert.equal(await page.locator(".live").count(), 0);
  assert.equal(await page.getByRole("button", { name: "Take a picture" }).isDisabled(), true);
}

await writeVideo();
await testPage(
  {
    folder: base,
    root: folder,
    browserArguments: ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream", `--use-file-for-fake-video-capture=${video}`],
  },
  record,
);
