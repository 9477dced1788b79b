// SPDX-License-Identifier: Apache-2.0
// The page of robots in a real browser: the grid of joints, a joint, and changes of a baseline.

import assert from "node:assert/strict";
import { after, afterEach, before, beforeEach, describe, test } from "node:test";
import { barriers, countCut, overflow } from "./access.mjs";
import { Stage, launchBrowser, until } from "./stage.mjs";

const ELBOW = "left/elbow"; // ERROR
const LEARNING = "left/wrist_3"; // one of its records differs from the others
const TOO_FEW_RECORDS = "right/wrist_1"
const PHONE = { width: 320, height: 640 };
const addressOf = (id, part = "faults") =>
  `#/actuator/%2Fema/${encodeURIComponent(id)}/${part}`;

let browser;
before(async () => { browser = await launchBrowser(); });
after(() => browser.close());

describe("two robots, joints without a robot, and two actuators", () => {
  let stage;
  let page;
  beforeEach(async () => { stage = await Stage.open("--actuators", 2, "--joints", 14); });
  afterEach(async () => {
    assert.deepEqual(page?.errors ?? [], []);
    await page?.context().close();
    stage.close();
  });

  async function open(hash = "", options = {}) {
    const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, ...options });
    page = await context.newPage();
    page.errors = [];
    page.on("pageerror", (error) => page.errors.push(String(error)));
    page.on("console", (entry) => {
      if (entry.type() === "error" && !/Failed to load resource/.test(entry.text())) {
        page.errors.push(entry.text());
      }
    });
    await page.goto(stage.address + hash);
  }

  const cell = (id) => page.locator(`[data-joint="/ema/${id}"]`);
  const level = async (id) => (await cell(id).locator(".badge").innerText()).trim();
  const messages = (id) => stage.source.send({ do: "messages", actuator: id });
  async function waitForAllCells() {
    await until("14 cells with their levels", async () =>
      (await page.locator(".joint").count()) === 14 &&
      (await page.locator(".joint.learning").count()) === 3 &&
      (await page.locator(".joint .sparkline").count()) === 11);
  }

  test("the grid shows the joints by robot, from worst to best", async () => {
    await open();
    await waitForAllCells();
    assert.deepEqual(await page.locator(".robot h2").allInnerTexts(), ["left", "right", "Joints"]);
    const order = ["ERROR", "WARN", "STALE", "LEARNING", "OK"];
    for (const name of ["left", "right", ""]) {
      const levels = await page.locator(`[data-robot="/ema/${name}"] .joint .badge`).allInnerTexts();
      const ranks = levels.map((text) => order.indexOf(text.trim()));
      assert.ok(!ranks.includes(-1), `${levels}`);
      assert.deepEqual(ranks, [...ranks].sort(), `the worst of ${name} comes first: ${levels}`);
    }
    // Actuators with a known drive remain in the table.
    assert.equal(await page.locator("table.overview tbody tr").count(), 2);
    assert.equal(await page.locator(".view-title .soft").innerText(), "14 joints, 2 actuators");
  });

  test("a cell shows friction with its interval, its trend, other changes and temperature", async () => {
    await open();
    await waitForAllCells();
    const { fault_estimate: estimate } = await messages(ELBOW);
    const friction = estimate.quantities.find(({ name }) => name === "friction");
    const text = (await cell(ELBOW).innerText()).replaceAll("\n", " ");
    assert.ok(text.includes(`friction +${(100 * friction.change).toFixed(1)} %`), text);
    assert.ok(text.includes(`to +${(100 * friction.high).toFixed(friction.high < 1 ? 1 : 0)} %`), text);
    assert.match(text, /winding \+31\.0 ± 2\.0 K/);
    assert.match(await cell("left/wrist_2").innerText(), /play \+0\.0021/);
    assert.match(await cell("right/elbow").innerText(), /torque per unit of effort −12\.0 %/);
    const trend = await cell(ELBOW).locator(".sparkline").getAttribute("aria-label");
    const last = Number(/to (\d+) %/.exec(trend)[1]);
    assert.ok(last > 80 && last <= Math.ceil(100 * friction.high), trend);
    // The trend is extended by each new record.
    await stage.source.send({ do: "test", actuator: ELBOW });
    await until("a trend with the new record", async () =>
      (await cell(ELBOW).locator(".sparkline").getAttribute("aria-label")) !== trend);
  });

  test("LEARNING has its own shape and colour, and shows its progress", async () => {
    await open();
    await waitForAllCells();
    assert.equal(await level(LEARNING), "LEARNING");
    const styleOf = (id) => cell(id).evaluate((element) => [
      getComputedStyle(element).borderLeftColor, element.querySelector(".level-shape").innerHTML,
    ]);
    const shown = await Promise.all([LEARNING, ELBOW, "left/wrist_2", "right/shoulder_pan",
      "left/wrist_1"].map(styleOf));
    for (const part of [0, 1]) assert.equal(new Set(shown.map((style) => style[part])).size, 5);
    const text = (await cell(LEARNING).innerText()).replaceAll("\u00a0", " ");
    assert.match(text, /4 of 10 records on 2 days/);
    assert.match(text, /friction changes above 15 % would show, above 38 % on another day/);
    assert.match(text, /3 more healthy records/);
    assert.match(await cell(TOO_FEW_RECORDS).innerText(), /a baseline needs at least 3/);
    // The table and the level filter also show LEARNING.
    const chip = page.locator(".chip.learning");
    assert.equal((await chip.innerText()).replace(/\s+/g, " ").trim(), "3 LEARNING");
    await page.getByRole("button", { name: "table" }).click();
    await chip.click();
    await until("the three learning joints", async () =>
      (await page.locator("table.overview tbody tr.learning").count()) === 3 &&
      (await page.locator("table.overview tbody tr").count()) === 3);
    await page.reload();
    await page.waitForSelector("table.overview");
    assert.equal(await page.locator(".joint").count(), 0, "a reload keeps the choice of the table");
  });

  test("a failure of a learning joint is shown, not hidden by LEARNING", async () => {
    await open();
    await waitForAllCells();
    await stage.source.send({ do: "set", actuator: LEARNING, level: 2 });
    await until("the error", async () => (await level(LEARNING)) === "ERROR");
    assert.match(await cell(LEARNING).innerText(), /4 of 10 records/);
  });

  test("a joint shows friction over speed, its changes, its trend in per cent and its baseline", async () => {
    await open(addressOf(ELBOW));
    await page.waitForSelector("[aria-labelledby=friction] canvas");
    await page.waitForSelector("[aria-labelledby=baseline]");
    const label = await page.locator("[aria-labelledby=friction] .plot").getAttribute("aria-label");
    const { friction_curve: curve, baseline } = await messages(ELBOW);
    const judged = curve.speed.map((_, i) => [curve.latest[i], curve.healthy_low[i], curve.healthy_high[i]])
      .filter((values) => values.every((value) => value !== null));
    const outside = judged.filter(([latest, low, high]) => latest < low || latest > high);
    assert.ok(outside.length > 0);
    assert.ok(label.endsWith(`${outside.length} of ${judged.length} speeds outside the healthy band`), label);
    assert.match(await page.locator("tr[data-quantity=friction]").innerText(), /changed/);
    const trend = await page.locator("[aria-labelledby=history] .plot").first().getAttribute("aria-label");
    assert.match(trend, /^friction over \d+ tests: now \+\d+ %, limit \+50 %/);
    const card = (await page.locator("[aria-labelledby=baseline]").innerText()).replaceAll("\u00a0", " ");
    for (const part of [`accepted by ${baseline.author}`, "12 records on 2 days", "0.21 to 1.3 rad/s",
      "52 % of the motion is forward", "8.7 %", "22 % on another day"]) {
      assert.ok(card.includes(part), `${part}: ${card}`);
    }
  });

  test("a person accepts a baseline; a refusal is shown and can be overruled", async () => {
    await open(addressOf(LEARNING));
    await page.getByRole("button", { name: "Accept", exact: true }).click();
    const form = page.locator("form.change");
    await form.getByRole("button", { name: "Accept the baseline" }).click();
    assert.equal(await form.locator("[role=alert]").count(), 0, "not sent without a name");
    await form.getByLabel("Name").fill("Grace Hopper");
    await form.getByLabel("Note").fill("new harmonic drive");
    assert.equal(await form.getByRole("checkbox").count(), 0);
    await form.getByRole("button", { name: "Accept the baseline" }).click();
    await form.locator("[role=alert]").waitFor();
    assert.match(await form.locator("[role=alert]").innerText(), /record 3 differs from the others/);
    assert.equal((await messages(LEARNING)).baseline.state, 0);
    await form.getByLabel("Accept anyway").check();
    await form.getByRole("button", { name: "Accept the baseline" }).click();
    await until("the accepted baseline", async () => (await form.count()) === 0 &&
      /accepted by Grace Hopper/.test(await page.locator("[aria-labelledby=baseline]").innerText()));
    const { requests } = await stage.source.send({ do: "requests" });
    assert.deepEqual(requests.at(-1), {
      actuator_id: LEARNING, change: 0, person: "Grace Hopper", note: "new harmonic drive", force: true,
    });
    await until("a level other than LEARNING", async () =>
      (await page.locator(".head .badge").first().innerText()).trim() !== "LEARNING");
  });

  test("an accepted baseline can be extended and reset", async () => {
    await open(addressOf(ELBOW));
    const card = page.locator("[aria-labelledby=baseline]");
    for (const [title, result] of [["Extend", /17 records/], ["Reset", /0 records on 0 days/]]) {
      await card.getByRole("button", { name: title, exact: true }).click();
      await card.getByLabel("Name").fill("Ada");
      await card.getByRole("button", { name: `${title} the baseline` }).click();
      await until(title, async () => result.test(await card.innerText()));
    }
    await until("the level LEARNING", async () =>
      (await page.locator(".head .badge").first().innerText()).trim() === "LEARNING");
    assert.equal(await page.locator(".head .banner").count(), 0, "learning is not a refusal");
  });

  test("the form keeps its text if the dashboard is unreachable", async () => {
    await open(addressOf(LEARNING));
    await page.getByRole("button", { name: "Accept", exact: true }).click();
    const form = page.locator("form.change");
    await form.getByLabel("Name").fill("Ada");
    await page.route("**/baseline", (route) => route.abort());
    await form.getByRole("button", { name: "Accept the baseline" }).click();
    await form.locator("[role=alert]").waitFor();
    assert.match(await form.locator("[role=alert]").innerText(), /the baseline is unchanged/);
    assert.equal(await form.getByLabel("Name").inputValue(), "Ada");
  });

  for (const colorScheme of ["light", "dark"]) {
    for (const [name, hash, ready] of [
      ["grid", "", ".joint.learning"],
      ["joint", addressOf(ELBOW), "[aria-labelledby=friction] canvas"],
      ["learning joint", addressOf(LEARNING), "[aria-labelledby=baseline]"],
    ]) {
      for (const [suffix, viewport] of [["", { width: 1280, height: 900 }], [" on a phone", PHONE]]) {
        test(`the page is accessible: ${name}${suffix}, ${colorScheme}`, async () => {
          await open(hash, { colorScheme, viewport });
          await page.waitForSelector(ready);
          const accept = page.getByRole("button", { name: "Accept", exact: true });
          if (await accept.count()) await accept.click();
          assert.deepEqual(await barriers(page), []);
          assert.ok(await overflow(page) <= 0, "wider than the screen");
          assert.equal(await countCut(page, ".joint, .joint-head, .card, form.change"), 0);
        });
      }
    }
  }

  test("a joint can be opened by a click anywhere in its cell, and with the keyboard", async () => {
    await open();
    await waitForAllCells();
    await cell(ELBOW).locator(".sparkline").click({ force: true });
    await page.waitForSelector(`h1:text("${ELBOW}")`);
    await page.goBack();
    await cell("right/elbow").locator("a").focus();
    await page.keyboard.press("Enter");
    await page.waitForSelector('h1:text("right/elbow")');
  });
});

test("the baseline of a recording cannot be changed", async () => {
  const stage = await Stage.open("--actuators", 0, "--joints", 4, "--without");
  await stage.source.send({ do: "playback", status: 0, rate: 1, position: 100 });
  const context = await browser.newContext();
  const page = await context.newPage();
  await page.goto(stage.address + addressOf(ELBOW));
  await page.waitForSelector("[aria-labelledby=baseline]");
  await page.waitForSelector(".playback");
  assert.equal(await page.getByRole("button", { name: "Reset" }).count(), 0);
  await context.close();
  stage.close();
});
