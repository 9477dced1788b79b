// SPDX-License-Identifier: Apache-2.0
// The archive page, with the dashboard's summary of a random fleet.

import assert from "node:assert/strict";
import { after, afterEach, before, describe, test } from "node:test";
import { barriers, overflow } from "./access.mjs";
import { randomFleet } from "./fleet.mjs";
import { Stage, launchBrowser, until } from "./stage.mjs";
import { load } from "./sources.mjs";

const format = await load("format.ts");
const { curveOf } = await load("archive.ts");
const fleet = randomFleet();
const formatCount = (count) => count.toLocaleString("en-GB");

test("the survival curve begins with all units and ends at the longest observed age", () => {
  const step = { age: 10, at_risk: 4, failed: 1, share: 0.75, lower: 0.5, upper: null };
  assert.deepEqual(curveOf({ survival: [step], longest_age: 30 }),
    [[0, 10, 30], [1, 0.75, 0.75], [1, 0.5, 0.5], [1, null, null]]);
  assert.deepEqual(curveOf({ survival: [], longest_age: 0 }), [[0], [1], [1], [1]]);
});

describe("an archive of 1600 units", () => {
  let browser;
  let stage;
  let page;
  before(async () => {
    browser = await launchBrowser();
    stage = await Stage.open("--actuators", 1);
  });
  after(async () => {
    stage.close();
    await browser.close();
  });
  afterEach(async () => {
    assert.deepEqual(page?.errors ?? [], []);
    await page?.context().close();
    page = undefined;
  });

  async function open(hash, summary, options = {}) {
    stage.origin.fleet = summary;
    const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, ...options });
    page = await context.newPage();
    page.errors = [];
    page.on("pageerror", (error) => page.errors.push(String(error)));
    await page.goto(stage.address + hash);
  }

  test("the page shows the values of the summary", async () => {
    await open("#/archive", fleet);
    await page.waitForSelector("#survival");
    for (const name of ["ok", "warn", "error", "stale"]) {
      const shown = await page.locator(`[data-count=${name}]`).innerText();
      assert.equal(shown.trim(), formatCount(fleet.levels[name]));
    }
    const worst = page.locator("[aria-labelledby=worst] tbody tr");
    assert.equal(await worst.count(), fleet.worst.length);
    for (const [k, unit] of fleet.worst.entries()) {
      const text = await worst.nth(k).innerText();
      const isOld = unit.health === "STALE" && /WARN|ERROR/.test(unit.last_health);
      assert.ok(text.includes(unit.serial_number), text);
      assert.ok(text.includes(isOld ? `${unit.last_health}, old` : unit.health), text);
      assert.ok(text.includes(`${format.hours(unit.flight_hours)} h`), text);
    }
    const note = await page.locator("[aria-labelledby=survival] .note").innerText();
    assert.ok(note.startsWith(`${formatCount(fleet.failures)} of ${formatCount(fleet.lives)} lives have ended.`), note);
    assert.equal(await page.locator("[aria-labelledby=survival] canvas").count(), 1);
    for (const [id, rows] of [["models", fleet.models], ["ages", fleet.ages]]) {
      const table = page.locator(`[aria-labelledby=${id}] tbody tr`);
      assert.equal(await table.count(), rows.length);
      for (const [k, row] of rows.entries()) {
        const cells = await table.nth(k).locator("td").allInnerTexts();
        assert.equal(cells[1], formatCount(row.units));
        assert.equal(cells[2], row.error ? formatCount(row.error) : "–");
      }
    }
    const ages = await page.locator("[aria-labelledby=calibrations] tbody").innerText();
    for (const { age, units } of fleet.calibrations) {
      assert.ok(ages.includes(age) && ages.includes(formatCount(units)), ages);
    }
    const coverage = await page.locator("[aria-labelledby=coverage]").innerText();
    assert.ok(coverage.includes(fleet.months.at(-1).month), coverage);
    assert.ok(coverage.includes(format.percent(fleet.recent[1].tested / fleet.recent[1].units)));
  });

  test("the page is linked only if the dashboard has an archive", async () => {
    await open("", { archive: null });
    await page.waitForSelector("table.overview tbody tr");
    assert.equal(await page.locator("nav").count(), 0);
    await page.context().close();
    await open("", fleet);
    await page.getByRole("link", { name: "Archive" }).click();
    await page.waitForSelector("#worst");
    assert.equal(await page.title(), "Archive · EMA health");
    await page.getByRole("link", { name: "Live" }).click();
    await page.waitForSelector("table.overview tbody tr");
  });

  test("the numbers of unreadable and partly readable bags are shown", async () => {
    const unreadable = ["/a.mcap", "/b.mcap"];
    const bags = { bags: 4000, damaged: 2, incomplete: 1, failed: 0, unread: 0, unreadable };
    await open("#/archive", { ...fleet, bags });
    const banner = await page.locator(".archive .banner").innerText();
    assert.equal(banner, "Of 4000 bags: 2 cannot be read, 1 can be read only in part. Unreadable: /a.mcap, /b.mcap");
  });

  test("the reason for a missing archive is shown", async () => {
    await open("#/archive", "the folder hangar_7 has no tables");
    const alert = await page.locator("[role=alert]").innerText();
    assert.match(alert, /hangar_7 has no tables/);
    await page.context().close();
    await open("#/archive", { archive: null });
    await until("the note that there is no archive", async () =>
      (await page.locator("main .empty").innerText()).includes("shows no archive"));
  });

  for (const colorScheme of ["light", "dark"]) {
    for (const viewport of [{ width: 1280, height: 900 }, { width: 390, height: 844 }]) {
      test(`the page is accessible: ${viewport.width} px, ${colorScheme}`, async () => {
        await open("#/archive", fleet, { colorScheme, viewport });
        await page.waitForSelector("[aria-labelledby=survival] canvas");
        assert.deepEqual(await barriers(page), []);
        // The plots adapt to the width of the screen one after another.
        await until("a page no wider than the screen", async () =>
          (await overflow(page)) <= 0);
      });
    }
  }
});
