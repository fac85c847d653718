// SPDX-License-Identifier: Apache-2.0
// Makes src/api/calibration.ts from the schema, checks all types and makes dist/: the workbench's script, style sheet and page, and
// the shell of the pages that the program writes, with script and style inside.
import { execFileSync } from "node:child_process";
import { createHash } from "node:crypto";
import { cpSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { build } from "esbuild";
import { typesOf } from "./types.mjs";

const schema = JSON.parse(readFileSync("calibration.schema.json", "utf8"));
writeFileSync("src/api/calibration.ts", typesOf(schema, "engine/json/calibration.schema.json"));
execFileSync(process.execPath, ["node_modules/typescript/bin/tsc", "-p", "."], { stdio: "inherit" });
mkdirSync("dist", { recursive: true });
await build({
  entryPoints: { workbench: "src/entry/workbench.tsx", report: "src/entry/report.tsx" },
  outdir: "dist",
  bundle: true,
  minify: true,
  format: "iife",
  target: ["es2022"],
  jsx: "automatic",
  jsxImportSource: "preact",
  legalComments: "inline",
  logLevel: "warning",
});
cpSync("src/entry/index.html", "dist/index.html");

// Nothing but this script and this style runs, and nothing is fetched.
const [script, style] = ["js", "css"].map((kind) => readFileSync(`dist/report.${kind}`, "utf8"));
if (/<\/(script|style)/i.test(script + style)) throw new Error("the text of the script or of the style ends its element");
const hash = (text) => `'sha256-${createHash("sha256").update(text).digest("base64")}'`;
const parts = {
  policy: `default-src 'none'; script-src ${hash(script)}; style-src ${hash(style)}; img-src data:; base-uri 'none'; form-action 'none'`,
  style,
  script: `<script>${script}</script>`,
};
const shell = readFileSync("src/entry/report.html", "utf8");
writeFileSync("dist/report.html", shell.replace(/@(policy|style|script)@/g, (_, name) => parts[name]));
