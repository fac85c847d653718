// SPDX-License-Identifier: Apache-2.0
// Checks the types and makes dist/: one script, one style sheet, one page.
import { execFileSync } from "node:child_process";
import { cpSync, mkdirSync } from "node:fs";
import { build } from "esbuild";

execFileSync(process.execPath, ["node_modules/typescript/bin/tsc", "-p", "."], { stdio: "inherit" });
mkdirSync("dist", { recursive: true });
await build({
  entryPoints: { workbench: "src/entry/workbench.tsx" },
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
