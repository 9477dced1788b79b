// SPDX-License-Identifier: Apache-2.0
// Bundle the page into the shipped folder; with --check, compare the bundle with that folder.
import { build } from "esbuild";
import { cp, mkdir, mkdtemp, readFile, readdir, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";

const here = path.dirname(fileURLToPath(import.meta.url));
const shipped = path.join(here, "../ema_dashboard/page");
const MOST_COMPRESSED = 200_000; // bytes

async function bundle(folder) {
  const { metafile } = await build({
    absWorkingDir: here,
    entryPoints: ["src/main.tsx", "src/worker.ts", "src/style.css"],
    outdir: folder,
    bundle: true,
    minify: true,
    format: "esm",
    target: ["es2022"],
    jsx: "automatic",
    jsxImportSource: "preact",
    legalComments: "none", // all licences are in one file
    metafile: true,
    charset: "utf8",
    define: { "process.env.NODE_ENV": '"production"' },
  });
  for (const name of ["index.html", "icon.svg"]) {
    await cp(path.join(here, "src", name), path.join(folder, name));
  }
  await writeFile(path.join(folder, "licences.txt"), await licences(Object.keys(metafile.inputs)));
}

/** Return the licences of the bundled packages as a text. */
async function licences(inputs) {
  const packages = inputs.map((name) => /node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(name)?.[1]);
  const texts = [];
  for (const name of [...new Set(packages.filter(Boolean))].sort()) {
    const folder = path.join(here, "node_modules", name);
    const { version, license } = JSON.parse(await readFile(path.join(folder, "package.json")));
    const file = (await readdir(folder)).find((entry) => /^licen[cs]e/i.test(entry));
    const text = file ? await readFile(path.join(folder, file), "utf8") : "";
    texts.push(`${name} ${version}, ${license}\n\n${text.trim()}\n`);
  }
  return texts.join(`\n${"-".repeat(80)}\n\n`);
}

async function contents(folder) {
  const names = (await readdir(folder)).sort();
  return new Map(await Promise.all(
    names.map(async (name) => [name, await readFile(path.join(folder, name))]),
  ));
}

const check = process.argv.includes("--check");
const temporary = await mkdtemp(path.join(tmpdir(), "ema-page-"));
try {
  await bundle(temporary);
  const bundled = await contents(temporary);
  let compressed = 0;
  for (const [name, bytes] of bundled) {
    const size = gzipSync(bytes, { level: 9 }).length;
    compressed += size;
    console.log(`${name.padEnd(20)} ${bytes.length} bytes, ${size} compressed`);
  }
  console.log(`${"total".padEnd(20)} ${compressed} compressed, at most ${MOST_COMPRESSED}`);
  if (compressed > MOST_COMPRESSED) {
    throw new Error(`the compressed bundle has ${compressed} bytes, more than ${MOST_COMPRESSED}`);
  }
  if (check) {
    const current = await contents(shipped);
    const names = new Set([...bundled.keys(), ...current.keys()]);
    const differing = [...names].filter((name) => {
      const [expected, actual] = [bundled.get(name), current.get(name)];
      return !expected || !actual || !expected.equals(actual);
    });
    if (differing.length) {
      throw new Error(`the shipped page differs from its sources in ${differing.join(", ")}: ` +
        "run `make page`");
    }
    console.log("the shipped page matches its sources");
  } else {
    await rm(shipped, { recursive: true, force: true });
    await mkdir(shipped, { recursive: true });
    for (const [name, bytes] of bundled) await writeFile(path.join(shipped, name), bytes);
  }
} finally {
  await rm(temporary, { recursive: true, force: true });
}
