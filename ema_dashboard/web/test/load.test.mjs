// 200 actuators with live telemetry: time of the page's main thread, and memory.
//
// LOAD_S=600 makes it the long form, in which nothing may grow.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";
import { Stage, browse } from "./stage.mjs";

const SECONDS = Number(process.env.LOAD_S ?? 10);
const MOST_BUSY = 0.3; // of a second
const MOST_GROWTH = 0.1; // of the heap, between the first and the last third
const LEAST_FRAMES = 8; // drawn in a second, of at most 20: browser and server share the cores

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

test(`200 actuators for ${SECONDS} s leave the main thread free`, async () => {
  const stage = await Stage.open("--actuators", 200, "--period", 5);
  const browser = await browse();
  const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
  const session = await page.context().newCDPSession(page);
  await session.send("Performance.enable", { timeDomain: "threadTicks" });
  await session.send("HeapProfiler.enable");
  const metrics = async () => Object.fromEntries(
    (await session.send("Performance.getMetrics")).metrics.map(({ name, value }) => [name, value]),
  );
  await stage.source.order({ do: "run", period: 5, telemetry: 1, open: "left_outboard_flap" });

  const system = await browser.newBrowserCDPSession();
  const resident = async () => {
    const { processInfo } = await system.send("SystemInfo.getProcessInfo");
    const sizes = await Promise.all(processInfo.filter(({ type }) => type === "renderer").map(
      async ({ id }) => Number(/VmRSS:\s+(\d+)/.exec(await readFile(`/proc/${id}/status`, "utf8"))[1])));
    return Math.max(...sizes) / 1000;
  };

  const measure = async (name, seconds) => {
    const heap = [];
    const [start, begun] = [await metrics(), performance.now()];
    const frames = await page.evaluate(() => globalThis.drawn ?? 0);
    const step = Math.max(seconds / 30, 1);
    while (performance.now() - begun < 1000 * seconds) {
      await pause(1000 * step);
      // Collecting is work of the main thread, too: only where memory is what counts.
      if (SECONDS >= 120) await session.send("HeapProfiler.collectGarbage");
      const { JSHeapUsedSize, Nodes } = await metrics();
      const worker = await page.workers()[0].evaluate(() => performance.memory?.usedJSHeapSize ?? 0);
      if (process.env.LOAD_VERBOSE) {
        const { TaskDuration } = await metrics();
        console.log(name, Math.round(performance.now() - begun), "main", (JSHeapUsedSize / 1e6).toFixed(1), "worker", (worker / 1e6).toFixed(1), "busy", (TaskDuration - start.TaskDuration).toFixed(1), "rss", await resident());
      }
      heap.push({ size: JSHeapUsedSize, nodes: Nodes, worker });
    }
    const [end, passed] = [await metrics(), (performance.now() - begun) / 1000];
    const busy = (end.TaskDuration - start.TaskDuration) / passed;
    const rate = ((await page.evaluate(() => globalThis.drawn ?? 0)) - frames) / passed;
    const third = Math.ceil(heap.length / 3);
    const mean = (list, of) => list.reduce((sum, one) => sum + one[of], 0) / list.length;
    const growth = (of) => mean(heap.slice(-third), of) / mean(heap.slice(0, third), of) - 1;
    const parts = ["Script", "Layout", "RecalcStyle"].map((one) =>
      `${one} ${((end[`${one}Duration`] - start[`${one}Duration`]) / passed).toFixed(3)}`);
    console.log(`${name}: ${busy.toFixed(3)} s a second, ${rate.toFixed(1)} drawings a second, ` +
      `heap ${(heap.at(-1).size / 1e6).toFixed(1)} MB (${(100 * growth("size")).toFixed(1)} %), ` +
      `${heap.at(-1).nodes} nodes (${(100 * growth("nodes")).toFixed(1)} %); ` +
      `${parts.join(", ")}`);
    return { busy, rate, growth };
  };

  try {
    await page.goto(stage.address);
    await page.waitForSelector("table.fleet tbody tr:nth-child(200)", { timeout: 30_000 });
    await pause(2000);
    const fleet = await measure("fleet", SECONDS / 2);
    await page.evaluate(() => {
      // Each drawing of a plot clears its canvas once.
      const clear = CanvasRenderingContext2D.prototype.clearRect;
      CanvasRenderingContext2D.prototype.clearRect = function count(...of) {
        if (this.canvas.closest("[aria-labelledby=live]")) globalThis.drawn = (globalThis.drawn ?? 0) + 1 / 3;
        return clear.apply(this, of);
      };
      location.hash = "#/actuator/%2Fema/left_outboard_flap";
    });
    await page.locator("#live").scrollIntoViewIfNeeded();
    await page.locator("[aria-labelledby=live]").scrollIntoViewIfNeeded();
    await pause(3000);
    const live = await measure("live plots", SECONDS);
    for (const { busy } of [fleet, live]) assert.ok(busy <= MOST_BUSY, `${busy} s a second`);
    assert.ok(live.rate >= LEAST_FRAMES && live.rate <= 21, `${live.rate} drawings a second`);
    if (SECONDS >= 120) {
      for (const of of ["size", "nodes"]) {
        assert.ok(live.growth(of) < MOST_GROWTH, `${of} grew by ${live.growth(of)}`);
      }
    }
  } finally {
    await browser.close();
    stage.close();
  }
});
