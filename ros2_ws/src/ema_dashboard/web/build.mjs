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

async function bundle(to) {
  const { metafile } = await build({
    absWorkingDir: here,
    entryPoints: ["src/main.tsx", "src/worker.ts", "src/style.css"],
    outdir: to,
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
    await cp(path.join(here, "src", name), path.join(to, name));
  }
  await writeFile(path.join(to, "licences.txt"), await licences(Object.keys(metafile.inputs)));
}

/** Text of the licences of the bundled packages. */
async function licences(inputs) {
  const found = inputs.map((name) => /node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(name)?.[1]);
  const texts = [];
  for (const name of [...new Set(found.filter(Boolean))].sort()) {
    const folder = path.join(here, "node_modules", name);
    const { version, license } = JSON.parse(await readFile(path.join(folder, "package.json")));
    const file = (await readdir(folder)).find((one) => /^licen[cs]e/i.test(one));
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
const to = await mkdtemp(path.join(tmpdir(), "ema-page-"));
try {
  await bundle(to);
  const made = await contents(to);
  let compressed = 0;
  for (const [name, bytes] of made) {
    const size = gzipSync(bytes, { level: 9 }).length;
    compressed += size;
    console.log(`${name.padEnd(20)} ${bytes.length} bytes, ${size} compressed`);
  }
  console.log(`${"in all".padEnd(20)} ${compressed} compressed, at most ${MOST_COMPRESSED}`);
  if (compressed > MOST_COMPRESSED) {
    throw new Error(`the bundle has ${compressed} bytes compressed, at most ${MOST_COMPRESSED}`);
  }
  if (check) {
    const there = await contents(shipped);
    const names = new Set([...made.keys(), ...there.keys()]);
    const differing = [...names].filter((name) => {
      const [one, other] = [made.get(name), there.get(name)];
      return !one || !other || !one.equals(other);
    });
    if (differing.length) {
      throw new Error(`the shipped page differs from its sources in ${differing.join(", ")}: ` +
        "run `make page`");
    }
    console.log("the shipped page is that of the sources");
  } else {
    await rm(shipped, { recursive: true, force: true });
    await mkdir(shipped, { recursive: true });
    for (const [name, bytes] of made) await writeFile(path.join(shipped, name), bytes);
  }
} finally {
  await rm(to, { recursive: true, force: true });
}
