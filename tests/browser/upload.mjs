// SPDX-License-Identifier: Apache-2.0
// From images that only the browser has to a session with the camera model that fits best.
//
//   node upload.mjs PROGRAM IMAGES NODE_MODULES [SCREENSHOTS]
import assert from "node:assert/strict";
import { mkdirSync, mkdtempSync, readdirSync, readFileSync, rmSync, symlinkSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { kPatience, look, problems, source as images, testPage } from "./harness.mjs";

const base = mkdtempSync(join(tmpdir(), "plenocal-upload-"));
const folder = join(base, "project");
const outside = join(base, "outside");
mkdirSync(folder);
mkdirSync(outside);
symlinkSync(outside, join(folder, "link"));
const left = readdirSync(images).filter((name) => /^left\d+\.jpg$/.test(name)).map((name) => join(images, name));

/** Status of an upload that the page does not make. */
const put = (page, server, query, body = "x", headers = {}) =>
  page.evaluate(
    async ([url, content, more]) => (await fetch(url, { method: "POST", body: content, headers: more })).status,
    [`/api/files?${new URLSearchParams(query)}`, body, { Authorization: `Bearer ${server.token}`, "Content-Type": "application/octet-stream", ...headers }],
  );

async function uploadAndTry(page, steps, server) {
  steps("nothing to begin with");
  await page.getByText("none yet").waitFor({ timeout: kPatience });
  assert.equal(await page.getByRole("button", { name: "Propose a session" }).isDisabled(), true);
  await look(page, "empty");

  steps("images are copied as they are, others are named and left out");
  const note = join(base, "note.txt");
  writeFileSync(note, "no image");
  await page.getByLabel("images or recordings").setInputFiles([...left, note]);
  await page.getByText(`${left.length} of ${left.length + 1} files are in the folder`).waitFor({ timeout: kPatience });
  await page.getByText("note.txt: is no image and no recording").waitFor();
  await page.getByText(`${left.length} images in the folder itself`).waitFor();
  for (const path of left) assert.deepEqual(readFileSync(join(folder, path.split("/").at(-1))), readFileSync(path));
  await look(page, "upload");
  const before = problems.splice(0);
  assert.ok(before.every((line) => /400/.test(line)), before.join("\n"));

  steps("a file is not replaced, nothing is written elsewhere");
  const name = left[0].split("/").at(-1);
  assert.equal(await put(page, server, { dir: "", name }), 400);
  assert.deepEqual(readFileSync(join(folder, name)), readFileSync(left[0]));
  for (const dir of ["link", "..", "a/b", "/tmp", ".plenocal", "-o"]) assert.equal(await put(page, server, { dir, name: "a.png" }), 400, dir);
  for (const bad of ["../a.png", "", ".a.png", "-o.png", "session.yaml", "a/b.png"]) assert.equal(await put(page, server, { dir: "", name: bad }), 400, bad);
  assert.equal(await put(page, server, { dir: "", name: "a.png" }, "x", { Authorization: "Bearer 0" }), 401);
  assert.equal(await put(page, server, { dir: "", name: "a.png" }, "x", { "Content-Type": "text/plain" }), 415);
  assert.deepEqual(readdirSync(outside), []);
  assert.deepEqual(readdirSync(folder).filter((entry) => !/^left\d+\.jpg$/.test(entry)).sort(), [".plenocal", "link"]);

  steps("more than a session's text, for those who have the token");
  assert.equal(await put(page, server, { dir: "large", name: "a.png" }, "x".repeat(5_000_000)), 201);
  assert.equal(readFileSync(join(folder, "large/a.png")).length, 5_000_000);
  rmSync(join(folder, "large"), { recursive: true });
  problems.splice(0); // the refusals above

  steps("a session of them");
  await page.getByRole("button", { name: "Propose a session" }).click();
  const target = page.getByRole("textbox", { name: /^Target/ });
  await target.waitFor({ timeout: kPatience });
  await target.fill((await target.inputValue()).replace(/^square:.*$/m, "square: 25 mm"));
  await page.locator("section", { has: target }).getByRole("button", { name: "Save" }).click();
  await page.getByText(`${left.length} images, auto`).waitFor({ timeout: kPatience });

  steps("models are tried, one is taken into the session, and taken back");
  await page.getByRole("button", { name: "Compare", exact: true }).click();
  await page.getByRole("button", { name: "Try all models" }).click();
  await page.locator("[data-recommended]").waitFor({ timeout: kPatience });
  const session = () => readFileSync(join(folder, "session.yaml"), "utf8");
  const old = session();
  await look(page, "models");
  await page.getByRole("button", { name: "Use kannala-brandt4" }).click();
  await page.locator("tr", { hasText: "kannala-brandt4" }).getByText("in the session").waitFor({ timeout: kPatience });
  assert.equal(session(), old.replace(/model: [\w-]+/, "model: kannala-brandt4"));
  await page.keyboard.press("Control+z");
  await page.getByRole("button", { name: "Use kannala-brandt4" }).waitFor({ timeout: kPatience });
  assert.equal(session(), old);
}

await testPage({ folder: base, root: folder }, uploadAndTry);
