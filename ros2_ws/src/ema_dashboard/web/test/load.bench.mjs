// SPDX-License-Identifier: Apache-2.0
// First paint of the page, then main-thread time and memory with 200 live actuators and with 60 joints.
//
// LOAD_S is the duration of each test [s]; from 120 s on, memory must not grow.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";
import { Stage, launchBrowser, until } from "./stage.mjs";

const SECONDS = Number(process.env.LOAD_S ?? 10);
const LONG_S = 120;
const MOST_PAINT_MS = 1000;
const MOST_BUSY = 0.3; // share of each second
const MOST_GROWTH = 0.1; // relative to the memory after garbage collection
const MOST_TASK_MS = 100; // longest task while the grid scrolls
const LEAST_FRAMES = 8; // per second; the page draws at most 20, but browser and server share the cores

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** Measurements of a page: main-thread time, and memory of its process including the worker. */
class Gauge {
  static async of(browser, page) {
    const gauge = new Gauge();
    gauge.session = await page.context().newCDPSession(page);
    gauge.system = await browser.newBrowserCDPSession();
    // Thread time, because other processes share the cores.
    await gauge.session.send("Performance.enable", { timeDomain: "threadTicks" });
    await gauge.session.send("HeapProfiler.enable");
    gauge.session.on("Target.attachedToTarget", ({ sessionId }) => { gauge.worker = sessionId; });
    await gauge.session.send("Target.setAutoAttach", {
      autoAttach: true, waitForDebuggerOnStart: false, flatten: false,
    });
    return gauge;
  }

  async metrics() {
    const { metrics } = await this.session.send("Performance.getMetrics");
    return Object.fromEntries(metrics.map(({ name, value }) => [name, value]));
  }

  /** Return heap [B], DOM nodes and resident memory [B] after garbage collection. */
  async memory() {
    const message = JSON.stringify({ id: 1, method: "HeapProfiler.collectGarbage" });
    await this.session.send("Target.sendMessageToTarget", { sessionId: this.worker, message });
    await this.session.send("HeapProfiler.collectGarbage");
    await pause(1000); // The worker collects its garbage asynchronously.
    const { JSHeapUsedSize: heap, Nodes: nodes } = await this.metrics();
    const { processInfo } = await this.system.send("SystemInfo.getProcessInfo");
    const sizes = await Promise.all(processInfo.filter(({ type }) => type === "renderer").map(
      async ({ id }) => /VmRSS:\s+(\d+) kB/.exec(await readFile(`/proc/${id}/status`, "utf8"))[1],
    ));
    return { heap, nodes, resident: 1000 * Math.max(...sizes.map(Number)) };
  }
}

/** Check the load of a page for some seconds; return the drawing rate of its live plots [1/s]. */
async function measure(gauge, page, name, seconds) {
  const drawn = () => page.evaluate(() => globalThis.drawn ?? 0);
  const before = await gauge.memory();
  const [start, frames, startTime] = [await gauge.metrics(), await drawn(), performance.now()];
  await pause(1000 * seconds);
  const [end, passed] = [await gauge.metrics(), (performance.now() - startTime) / 1000];
  const busy = (end.TaskDuration - start.TaskDuration) / passed;
  const rate = ((await drawn()) - frames) / passed;
  const after = await gauge.memory();
  const growth = (quantity) => after[quantity] / before[quantity] - 1;
  const percent = (quantity) => `${(100 * growth(quantity)).toFixed(1)} %`;
  console.log(`${name}: ${busy.toFixed(3)} s per second, ${rate.toFixed(1)} drawings per second, ` +
    `heap ${(after.heap / 1e6).toFixed(1)} MB (${percent("heap")}), ${after.nodes} nodes ` +
    `(${percent("nodes")}), resident ${(after.resident / 1e6).toFixed(0)} MB ` +
    `(${percent("resident")})`);
  assert.ok(busy <= MOST_BUSY, `${name}: ${busy} s per second`);
  if (SECONDS >= LONG_S) {
    for (const quantity of Object.keys(after)) {
      assert.ok(growth(quantity) < MOST_GROWTH, `${name}: ${quantity} grew by ${percent(quantity)}`);
    }
  }
  return rate;
}

test("the first paint comes within a second", async () => {
  const stage = await Stage.open();
  const browser = await launchBrowser();
  try {
    const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
    await page.goto(stage.address);
    await page.waitForSelector("table.overview tbody tr");
    const paint = await page.evaluate(() =>
      performance.getEntriesByName("first-contentful-paint")[0].startTime);
    console.log(`first paint after ${paint.toFixed(0)} ms`);
    assert.ok(paint < MOST_PAINT_MS, `${paint} ms`);
  } finally {
    await browser.close();
    stage.close();
  }
});

test(`200 actuators for ${SECONDS} s leave the main thread free`, async () => {
  const stage = await Stage.open("--actuators", 200, "--period", 5);
  const browser = await launchBrowser();
  const page = await browser.newPage({ viewport: { width: 1280, height: 900 } });
  const gauge = await Gauge.of(browser, page);

  try {
    await stage.source.send({ do: "run", period: 5, telemetry: 1, open: "left_outboard_flap" });
    await page.goto(stage.address);
    await page.waitForSelector("table.overview tbody tr:nth-child(200)", { timeout: 30_000 });
    await pause(2000);
    await measure(gauge, page, "overview", SECONDS / 2);
    await page.evaluate(() => {
      // Each drawing of one of the three live plots clears its canvas once.
      const clear = CanvasRenderingContext2D.prototype.clearRect;
      CanvasRenderingContext2D.prototype.clearRect = function count(...args) {
        const isLive = this.canvas.closest("[aria-labelledby=live]") !== null;
        if (isLive) globalThis.drawn = (globalThis.drawn ?? 0) + 1 / 3;
        return clear.apply(this, args);
      };
      location.hash = "#/actuator/%2Fema/left_outboard_flap/telemetry";
    });
    await page.locator("[aria-labelledby=live]").scrollIntoViewIfNeeded();
    await pause(5000 + (SECONDS >= LONG_S ? 25_000 : 0)); // until the buffers are full
    const rate = await measure(gauge, page, "live plots", SECONDS);
    assert.ok(rate >= LEAST_FRAMES && rate <= 21, `${rate} drawings per second`);
  } finally {
    await browser.close();
    stage.close();
  }
});

test(`60 joints for ${SECONDS} s leave the main thread free, also while the grid scrolls`, async () => {
  const stage = await Stage.open("--actuators", 0, "--joints", 60, "--period", 5);
  const browser = await launchBrowser();
  try {
    for (const [name, viewport] of [["grid", { width: 1440, height: 3000 }],
      ["grid on a phone", { width: 320, height: 640 }]]) {
      const page = await browser.newPage({ viewport });
      const gauge = await Gauge.of(browser, page);
      await page.goto(stage.address);
      await until("60 joints", async () => (await page.locator(".joint").count()) === 60 &&
        (await page.locator(".joint .sparkline").count()) === 57, 60_000);
      // A record per joint every 5 s: twelve times the highest rate of a monitor.
      await stage.source.send({ do: "run", period: 5 });
      await pause(2000);
      await measure(gauge, page, name, SECONDS / 2);
      const longest = await page.evaluate((ms) => new Promise((resolve) => {
        const tasks = [0];
        new PerformanceObserver((list) => tasks.push(...list.getEntries().map((entry) => entry.duration)))
          .observe({ entryTypes: ["longtask"] });
        const start = performance.now();
        const height = document.documentElement.scrollHeight - innerHeight;
        const step = () => {
          const passed = performance.now() - start;
          scrollTo(0, height * Math.abs(Math.sin(passed / 1000)));
          if (passed < ms) requestAnimationFrame(step);
          else resolve(Math.max(...tasks));
        };
        step();
      }), 500 * SECONDS);
      console.log(`${name}: longest task while scrolling ${longest.toFixed(0)} ms`);
      assert.ok(longest <= MOST_TASK_MS, `${name}: a task of ${longest} ms`);
      await stage.source.send({ do: "halt" });
      await page.close();
    }
  } finally {
    await browser.close();
    stage.close();
  }
});
