// SPDX-License-Identifier: Apache-2.0
// Playback of a recording to a real monitor and dashboard, shown by the page.

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { once } from "node:events";
import { createInterface } from "node:readline";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { launchBrowser, until } from "./stage.mjs";
import { load } from "./sources.mjs";

const { FAULTS } = await load("faults.ts");
const BAG = fileURLToPath(new URL("../../../../../bags/faulty_flap.mcap", import.meta.url));
const DOMAIN = `
import sys
from ema_core.domains import Domain
domain = Domain()
print(domain.number, flush=True)
sys.stdin.read()
domain.close()
`;
const environment = { ...process.env, ROS_AUTOMATIC_DISCOVERY_RANGE: "LOCALHOST" };

/** Reserve an unused ROS domain until `free` is called. */
async function reserveDomain() {
  const holder = spawn("python", ["-c", DOMAIN], { stdio: ["pipe", "pipe", "inherit"] });
  const [number] = await once(createInterface({ input: holder.stdout }), "line");
  return { number, free: () => holder.stdin.end() };
}

/** Start a command of `ema`; `stop` interrupts it and waits for its exit. */
function run(...args) {
  const child = spawn("ema", args, { env: environment, stdio: ["ignore", "pipe", "pipe"] });
  const lines = [];
  for (const stream of [child.stdout, child.stderr]) {
    createInterface({ input: stream }).on("line", (line) => lines.push(line));
  }
  const exited = new Promise((resolve) => child.on("exit", resolve));
  return { lines, stop: () => { child.kill("SIGINT"); return exited; } };
}

test("a replayed bag drives the page as live messages do", async () => {
  const expected = JSON.parse(execFileSync("ema", ["estimate", BAG, "--json"]))[0];
  const domain = await reserveDomain();
  environment.ROS_DOMAIN_ID = domain.number;
  const nodes = run("up", "monitor", "dashboard", "-p", "use_sim_time:=true");
  const browser = await launchBrowser();
  let player;
  try {
    const line = await until("the dashboard's address",
      () => nodes.lines.find((line) => /dashboard at http/.test(line)), 60_000);
    const page = await browser.newPage();
    const urls = [];
    const errors = [];
    page.on("request", (request) => urls.push(request.url()));
    page.on("console", (entry) => entry.type() === "error" && errors.push(entry.text()));
    const address = /http:\S+/.exec(line)[0];
    await page.goto(address);
    await page.waitForSelector("text=/No (test|actuator) yet/");
    // Slow machines may start the monitor later than the dashboard; the player would not wait for it.
    await until("an active monitor",
      () => nodes.lines.some((line) => /ema\.monitor\]: active/.test(line)), 60_000);
    player = run("play", BAG, "--only-actuator", "--stay");
    await page.waitForSelector("tr[data-actuator='/ema/flap'] .badge.warn", { timeout: 60_000 });
    await page.waitForSelector(".playback >> text=faulty_flap");
    await page.getByRole("link", { name: "flap" }).click();
    await page.getByRole("link", { name: "Evidence" }).click();
    const shown = (name) =>
      page.locator(`[aria-labelledby=vector] tr[data-fault=${name}] [data-value]`);
    await shown("friction").waitFor();
    for (const { name } of FAULTS) {
      const value = Number(await shown(name).getAttribute("data-value"));
      assert.equal(value, expected.faults[name], `${name} equals the value of ema estimate`);
    }
    const lastTest = page.locator(".figure", { hasText: "last test" });
    assert.match(await lastTest.innerText(), /\d s ago/, "relative to the time of the recording");
    // After a seek to the start, the health is unknown and the player is paused.
    await until("the end of the recording", async () =>
      /ended/.test(await page.locator(".playback .bag").innerText()), 30_000);
    await page.getByLabel("Position in the recording").focus();
    await page.keyboard.press("Home");
    await page.waitForSelector("text=The health is unknown");
    await page.getByRole("button", { name: "Play" }).click();
    await page.waitForSelector(".head .badge.warn", { timeout: 60_000 });
    for (const url of urls) assert.equal(new URL(url).host, new URL(address).host);
    assert.deepEqual(errors.filter((text) => /Content Security Policy/.test(text)), []);
  } finally {
    await browser.close();
    await player?.stop();
    await nodes.stop();
    domain.free();
  }
});
