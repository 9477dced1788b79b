// SPDX-License-Identifier: Apache-2.0
// Environment of the tests and screenshots: synthetic messages, a web server and a browser.

import { execFileSync, spawn } from "node:child_process";
import { createInterface } from "node:readline";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";
import { Origin } from "./origin.mjs";

const SERVER = fileURLToPath(new URL("../../../../../tests/web/synthetic_server.py", import.meta.url));

/** A process of synthetic_server.py, which answers each command. */
export class Source {
  #process;
  #answers = [];
  #waiting = [];

  constructor(...options) {
    this.#process = spawn("python", [SERVER, ...options.map(String)], {
      stdio: ["pipe", "pipe", "inherit"],
    });
    createInterface({ input: this.#process.stdout }).on("line", (line) => {
      const waiting = this.#waiting.shift();
      if (waiting) waiting.resolve(JSON.parse(line));
      else this.#answers.push(JSON.parse(line));
    });
    this.#process.on("exit", (code) => {
      for (const { reject } of this.#waiting) reject(new Error(`synthetic_server.py exited with ${code}`));
    });
  }

  /** Send a command, and return the answer. */
  send(command) {
    this.#process.stdin.write(`${JSON.stringify(command)}\n`);
    return new Promise((resolve, reject) => this.#waiting.push({ resolve, reject }));
  }

  close() {
    this.#process.stdin.end();
  }
}

function browserPath() {
  if (process.env.CHROMIUM) return process.env.CHROMIUM;
  for (const name of ["chromium", "chromium-browser", "google-chrome"]) {
    try {
      return execFileSync("sh", ["-c", `command -v ${name}`], { encoding: "utf8" }).trim();
    } catch {
      // Try the next name.
    }
  }
  throw new Error("no Chromium on PATH: install it, or set CHROMIUM to the path of a browser");
}

/** Start the system's Chromium without a window. */
export function launchBrowser() {
  // The sandbox needs user namespaces, which containers lack; the tests open the shipped page only.
  const args = ["--no-sandbox", "--disable-dev-shm-usage", "--enable-precise-memory-info"];
  return chromium.launch({ executablePath: browserPath(), args });
}

/** The message source and the web server of a test, with the address of the page. */
export class Stage {
  static async open(...options) {
    const stage = new Stage();
    stage.source = new Source(...options);
    stage.origin = new Origin();
    stage.address = await stage.origin.listen();
    await stage.start();
    return stage;
  }

  async start() {
    this.origin.backend = (await this.source.send({ do: "start" })).port;
  }

  close() {
    this.origin.close();
    this.source.close();
  }
}

/**
 * Wait until a function, which may be asynchronous, returns a true value; return the value.
 * If this takes longer than a limit [ms], throw an error that names the expected state.
 */
export async function until(expected, check, limit_ms = 15_000) {
  const end = performance.now() + limit_ms;
  let last;
  for (;;) {
    last = await check();
    if (last) return last;
    if (performance.now() > end) throw new Error(`not within ${limit_ms} ms: ${expected}`);
    await new Promise((resolve) => setTimeout(resolve, 20));
  }
}
