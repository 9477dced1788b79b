// SPDX-License-Identifier: Apache-2.0
// Load TypeScript modules of the page in Node; old versions of Node cannot read TypeScript.

import { build } from "esbuild";
import { fileURLToPath } from "node:url";

export async function load(name) {
  const { outputFiles } = await build({
    entryPoints: [fileURLToPath(new URL(`../src/${name}`, import.meta.url))],
    bundle: true,
    write: false,
    format: "esm",
    platform: "node",
  });
  const encoded = Buffer.from(outputFiles[0].contents).toString("base64");
  return import(`data:text/javascript;base64,${encoded}`);
}
