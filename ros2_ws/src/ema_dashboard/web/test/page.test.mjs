// SPDX-License-Identifier: Apache-2.0
// The page in a real browser, driven by a server with synthetic messages.

import assert from "node:assert/strict";
import { after, afterEach, before, beforeEach, describe, test } from "node:test";
import { barriers, countCut, overflow } from "./access.mjs";
import { Stage, launchBrowser, until } from "./stage.mjs";
import { load } from "./sources.mjs";

const format = await load("format.ts");
const LEVELS = ["OK", "WARN", "ERROR", "STALE"];
const WORN = "left_outboard_flap";
const DEPARTED = 5; // value of FaultEstimate.verdict
const addressOf = (id, part = "faults") => `#/actuator/%2Fema/${id}/${part}`;

let browser;
before(async () => { browser = await launchBrowser(); });
after(() => browser.close());

async function open(stage, hash = "", options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, ...options });
  const page = await context.newPage();
  page.errors = [];
  page.requestedUrls = [];
  page.on("pageerror", (error) => page.errors.push(String(error)));
  page.on("console", (entry) => {
    // Some tests cause failed connections on purpose.
    if (entry.type() === "error" && !/WebSocket|Failed to load resource/.test(entry.text())) {
      page.errors.push(entry.text());
    }
  });
  page.on("request", (request) => page.requestedUrls.push(request.url()));
  page.on("websocket", (socket) => page.requestedUrls.push(socket.url()));
  await page.goto(stage.address + hash);
  return page;
}

const row = (page, id) => page.locator(`tr[data-actuator="/ema/${id}"]`);
const levelShown = async (page, id) => (await row(page, id).locator(".c-level").innerText()).trim();

describe("nine actuators", () => {
  let stage;
  let page;
  beforeEach(async () => { stage = await Stage.open(); });
  afterEach(async () => {
    assert.deepEqual(page?.errors ?? [], []);
    await page?.context().close();
    stage.close();
  });

  test("the overview shows the values of the messages, from worst to best", async () => {
    page = await open(stage);
    await until("nine rows with the values of all messages", async () =>
      (await page.locator("tbody td.c-advice span").count()) === 9 &&
      (await page.locator("tbody td.c-health strong").count()) === 9);
    const ids = await page.locator("tbody .c-actuator a").allInnerTexts();
    assert.equal(ids.length, 9);
    const ranks = [];
    for (const id of ids) {
      const { health, advice } = await stage.source.send({ do: "messages", actuator: id });
      assert.equal(await levelShown(page, id), LEVELS[health.level]);
      const shown = row(page, id);
      const index = await shown.locator(".c-health strong").innerText();
      assert.equal(index, format.fixed(health.health_index, 2));
      const life = await shown.locator(".c-life").innerText();
      if (health.rul.hours_95 > 0) {
        assert.match(life, new RegExp(`^${format.lifeHours(health.rul.hours_50, health.rul)} h`));
      } else assert.equal(life, "none left");
      if (health.cause) {
        assert.ok((await shown.locator(".c-cause").innerText()).replace("\n", " ")
          .includes(health.cause));
      }
      const action = ["unknown", "continue", "inspect", "remove"][advice.action];
      assert.equal(await shown.locator(".c-advice").innerText(), action);
      assert.match(await shown.locator(".c-remove").innerText(),
        /^(now|no date|in [\d,.]+ h\s+service [\d,.]+ h)$/);
      ranks.push([2, 1, 3, 0].indexOf(health.level));
    }
    assert.equal(await countCut(page, "tbody td"), 0);
    assert.deepEqual(ranks, [...ranks].sort(), "the worst comes first");
  });

  test("a change of level appears within a second", async () => {
    page = await open(stage);
    await row(page, "rudder").waitFor();
    for (const level of [2, 1, 3, 0]) {
      const start = performance.now();
      await stage.source.send({ do: "set", actuator: "rudder", level });
      await until(`level ${LEVELS[level]}`,
        async () => (await levelShown(page, "rudder")) === LEVELS[level]);
      const passed = performance.now() - start;
      assert.ok(passed < 1000, `${LEVELS[level]} after ${passed.toFixed(0)} ms`);
    }
  });

  test("the page of an actuator shows the values of its messages with their sigma", async () => {
    page = await open(stage, addressOf(WORN));
    await page.waitForSelector("[aria-labelledby=tracked]");
    const messages = await stage.source.send({ do: "messages", actuator: WORN });
    const { health, fault_estimate: estimate, advice } = messages;
    assert.match(await page.locator(".why").innerText(), /\(warns above [\d.]+, fails above/);
    assert.equal(await page.locator(".removal").first().innerText(), health.removal);
    assert.ok((await page.locator(".todo").innerText()).includes(advice.reason));
    for (const item of health.faults) {
      const cell = page.locator(`[aria-labelledby=tracked] tr[data-item=${item.name}] [data-value]`);
      assert.equal(Number(await cell.getAttribute("data-value")), item.value);
      assert.equal(await cell.innerText(), format.withSigma(item.value, item.sigma));
    }
    await page.getByRole("link", { name: "Evidence" }).click();
    const names = Object.keys(estimate.faults);
    for (const [k, name] of names.entries()) {
      const sigma = Math.sqrt(estimate.covariance[9 * k]);
      const cell = page.locator(`[aria-labelledby=vector] tr[data-fault=${name}] [data-value]`);
      assert.equal(await cell.innerText(), format.withSigma(estimate.faults[name], sigma));
    }
    const matrix = await page.locator("table.matrix tbody td").allInnerTexts();
    assert.equal(matrix.length, 64);
    const shown = Number(matrix[1].replace("−", "-"));
    const [xx, xy, yy] = [estimate.covariance[0], estimate.covariance[1], estimate.covariance[9]];
    assert.ok(Math.abs(shown - xy / Math.sqrt(xx * yy)) <= 0.005);
    await page.getByRole("link", { name: "Last test" }).click();
    const window = await page.locator("[aria-labelledby=window]").innerText();
    assert.ok(window.includes("winding temperature 41.3 ± 2.6 K"), window);
    assert.ok(window.includes("3.1 %"), "the unexplained share");
  });

  test("the summary fits on one screen with faults in per cent, and each part has a link", async () => {
    const [eccentric, failed] = [addressOf(WORN, "events"), addressOf("right_outboard_flap", "events")];
    for (const [hash, width, height] of [[eccentric, 1280, 800], [failed, 1280, 800],
      [eccentric, 390, 844], [failed, 390, 844]]) {
      page = await open(stage, hash, { viewport: { width, height } });
      await page.waitForSelector(".summary canvas");
      const parts = await page.locator(".parts").boundingBox();
      const end = parts.y + parts.height;
      assert.ok(end <= height, `${hash} at ${width} px: ends at ${end}`);
      assert.ok(await page.evaluate(() => document.documentElement.scrollWidth) <= width, "wider than the screen");
      assert.equal(await countCut(page, ".figure"), 0);
      const pageHeight = await page.evaluate(() => document.documentElement.scrollHeight);
      assert.ok(pageHeight < 2 * height + 200, `${pageHeight} px`);
      await page.context().close();
    }
    page = await open(stage, addressOf(WORN));
    await page.waitForSelector(".summary canvas");
    const { health } = await stage.source.send({ do: "messages", actuator: WORN });
    const { value } = health.faults.find(({ name }) => name === "eccentricity");
    const text = await page.locator("[data-wrong=eccentricity]").innerText();
    assert.equal(text.replace("\n", " "),
      `eccentricity ${(100 * value).toFixed(0)} % fails at 60 %`);
    assert.match(await page.locator("tr[data-item=friction]").innerText(), /\+10 %/);
    for (const [part, id] of [["Life", "remaining"], ["Last test", "window"],
      ["Evidence", "vector"], ["Telemetry", "diagnostics"], ["Events", "events"]]) {
      await page.getByRole("link", { name: part }).click();
      await page.waitForSelector(`#${id}`);
      assert.equal(await page.locator(".parts [aria-current]").innerText(), part);
    }
  });

  test("adjacent plots are aligned even if a heading has two lines", async () => {
    page = await open(stage, addressOf(WORN), { viewport: { width: 1440, height: 900 } });
    await page.waitForSelector(".plots.many canvas");
    const bottoms = await page.$$eval(".plots.many figure", (figures) => figures.map((figure) =>
      figure.getBoundingClientRect().bottom - figure.lastElementChild.getBoundingClientRect().bottom));
    assert.equal(bottoms.length, 7);
    for (const below of bottoms) assert.ok(below < 1, `${bottoms}`);
  });

  test("unset values take no space, and a legend shows values only under the cursor", async () => {
    await stage.source.send({ do: "set", actuator: WORN, costs: false });
    page = await open(stage, addressOf(WORN, "test"));
    await page.waitForSelector(".removal");
    assert.match(await page.locator(".todo .what").innerText(), /^Remove in [\d,]+ h$/);
    const head = await page.locator(".head").innerText();
    assert.ok(!/advice|costs/i.test(head), head);
    const legend = page.locator("[aria-labelledby=window] .u-legend").first();
    await legend.waitFor();
    assert.equal((await legend.innerText()).replace(/\s+/g, " ").trim(), "measured model");
    const plotArea = page.locator("[aria-labelledby=window] .u-over").first();
    let moves = 0;
    await until("values", async () => {
      await plotArea.hover({ position: { x: 60 + 7 * (moves++ % 9), y: 60 } });
      return /measured\s*−?\d/.test(await legend.innerText());
    });
    await page.goto(stage.address);
    await page.waitForSelector("td.c-advice");
    for (const id of await page.locator("tbody .c-actuator a").allInnerTexts()) {
      await stage.source.send({ do: "set", actuator: id, costs: false });
    }
    await until("no advice", async () => (await page.locator(".c-advice").count()) === 0);
  });

  test("values of a diagnostic status are shown with their unit and four digits", async () => {
    await stage.source.send({ do: "run", period: 20 });
    page = await open(stage, addressOf(WORN, "telemetry"));
    const collapsed = page.locator(".quiet > summary");
    assert.equal(await collapsed.innerText(), "1 OK");
    await collapsed.click();
    await page.locator(".diagnostics summary").first().click();
    assert.deepEqual(await page.locator(".diagnostics strong").allInnerTexts(), ["health", "telemetry"]);
    const shown = await page.locator(".diagnostics .values").first().innerText();
    assert.match(shown.replace(/\s+/g, " "), /latency 0\.1235 s/);
  });

  test("a reload keeps the history and the open part", async () => {
    page = await open(stage, addressOf(WORN));
    const note = page.locator("[aria-labelledby=history] .note");
    await stage.source.send({ do: "test", actuator: WORN });
    await until("41 tests", async () => (await note.innerText()).startsWith("41 tests"));
    await page.reload();
    await until("41 tests again", async () =>
      (await note.count()) && (await note.innerText()).startsWith("41 tests"));
    assert.equal(await page.locator("h1").innerText(), WORN);
    await page.getByRole("link", { name: "Events" }).click();
    await page.reload();
    await until("events", async () => (await page.locator("ol.events li").count()) >= 6);
  });

  test("a refused test is shown with its reason, and the earlier health remains", async () => {
    page = await open(stage, addressOf(WORN, "events"));
    await page.waitForSelector(".why");
    const reason = "the calibration expired: calibrate the unit";
    await stage.source.send({ do: "test", actuator: WORN, refused: reason });
    const banner = page.locator(".head .banner.error");
    await banner.waitFor();
    assert.ok((await banner.innerText()).includes(reason));
    assert.equal((await page.locator(".head-line .badge").innerText()).trim(), "WARN");
    await until("an event", async () =>
      (await page.locator("ol.events").innerText()).includes(reason));
    await page.reload();
    await until("the event again", async () => (await page.locator("ol.events").count()) &&
      (await page.locator("ol.events").innerText()).includes(reason));
  });

  test("a note on an event is sent with its author, and remains in the form if it is refused", async () => {
    page = await open(stage, addressOf(WORN, "events"));
    const answers = [{ status: 400, body: "not today" }, { status: 204 }];
    const sent = [];
    await page.route("**/note", (route) => {
      sent.push(route.request().postDataJSON());
      return route.fulfill(answers.shift());
    });
    await page.locator("ol.events button").first().click();
    const form = page.locator("form.note");
    await form.getByLabel("Name").fill("Ada");
    await form.getByLabel("Note").fill("greased");
    await form.getByRole("button").click();
    await until("the refusal", async () => (await form.innerText()).includes("not today"));
    await stage.source.send({ do: "test", actuator: WORN });
    await page.setViewportSize({ width: 390, height: 844 });
    assert.ok((await overflow(page)) <= 0);
    await form.getByRole("button").click();
    await form.waitFor({ state: "detached" });
    const { namespace, actuator_id, person, text, sec } = sent[1];
    assert.deepEqual([namespace, actuator_id, person, text], ["/ema", WORN, "Ada", "greased"]);
    assert.ok(sec > 0);
  });

  test("a departing test causes a warning with the departing quantities, and an event", async () => {
    page = await open(stage, addressOf(WORN, "events"));
    await page.waitForSelector(".why");
    const reason = "current at rest +38 %, 6.1 sigma; no fault explains it";
    await stage.source.send({ do: "test", actuator: WORN, refused: reason, verdict: DEPARTED });
    const banner = page.locator(".head .banner.warn");
    await banner.waitFor();
    assert.match(await banner.innerText(), /differs from healthy tests/);
    assert.ok((await banner.innerText()).includes(reason));
    assert.equal(await page.locator(".head .banner.error").count(), 0);
    await until("an event", async () =>
      (await page.locator("ol.events").innerText()).includes(reason));
  });

  test("an estimate of ordinary motion states why there are no signals", async () => {
    page = await open(stage, addressOf(WORN, "test"));
    const section = page.locator("[aria-labelledby=window]");
    await until("signals", async () => (await section.locator("canvas").count()) > 0);
    await stage.source.send({ do: "move", actuator: WORN, stretches: 7 });
    await section.locator("text=combines 7 stretches of ordinary motion").waitFor();
    assert.equal(await section.locator("canvas").count(), 0);
  });

  test("the page reconnects when the server restarts", async () => {
    page = await open(stage);
    await row(page, "rudder").waitFor();
    stage.origin.isDown = true;
    await stage.source.send({ do: "stop" });
    await page.waitForSelector(".banner.error.wide >> text=Disconnected for");
    assert.equal((await page.locator(".connected").innerText()).trim(), "disconnected");
    assert.equal(await page.locator("tbody tr").count(), 9, "the last received values remain");
    await stage.source.send({ do: "set", actuator: "rudder", level: 2, share: 1.4 });
    await stage.start();
    stage.origin.isDown = false;
    await until("the new level", async () => (await levelShown(page, "rudder")) === "ERROR");
    assert.equal(await page.locator(".banner.wide").count(), 0);
    assert.equal(await page.locator("tbody tr").count(), 9);
  });

  test("a refusing server is distinguished from an unreachable one", async () => {
    stage.origin.refusalStatus = 503;
    page = await open(stage);
    await page.waitForSelector("text=Not allowed");
    assert.match(await page.locator("main").innerText(), /reached its limit of clients/);
    for (const [status, reason] of [
      [401, "the token is wrong: Authorization: Bearer, or /?token="],
      [403, "host 'box' is not one of this dashboard: see its parameter host_names"],
      [403, "origin 'http://box' may not connect: see the parameter allowed_origins"],
    ]) {
      Object.assign(stage.origin, { refusalStatus: status, refusalReason: reason });
      await until("the reason", async () =>
        (await page.locator("main").innerText()).includes(reason));
    }
    stage.origin.refusalStatus = 0;
    await row(page, "rudder").waitFor();
  });

  test("the table can be sorted and filtered, and an actuator opened, with the keyboard alone", async () => {
    page = await open(stage);
    await row(page, "rudder").waitFor();
    await page.keyboard.press("Tab");
    assert.equal(await page.evaluate(() => document.activeElement.className), "skip");
    await page.getByRole("button", { name: "Actuator" }).focus();
    await page.keyboard.press("Enter");
    const first = page.locator("tbody .c-actuator a").first();
    await until("sorted by name", async () => (await first.innerText()) === "elevator");
    assert.equal(await page.locator("th[aria-sort=ascending]").innerText().then((t) => t.trim())
      .then((t) => t.startsWith("Actuator")), true);
    await page.getByRole("searchbox").focus();
    await page.keyboard.type("rud");
    await until("one row", async () => (await page.locator("tbody tr").count()) === 1);
    await first.focus();
    await page.keyboard.press("Enter");
    await page.waitForSelector("h1:text('rudder')");
  });

  test("all requests go to the origin of the page, and its policy blocks none of them", async () => {
    await stage.source.send({ do: "run", period: 5, open: WORN });
    page = await open(stage, addressOf(WORN));
    await page.waitForSelector(".plots.many canvas");
    await page.goto(stage.address);
    await row(page, "rudder").waitFor();
    assert.ok(page.requestedUrls.some((url) => url.startsWith("ws://127.0.0.1")));
    for (const url of page.requestedUrls) {
      assert.equal(new URL(url).host, new URL(stage.address).host, url);
    }
  });

  for (const colorScheme of ["light", "dark"]) {
    for (const [name, hash, viewport] of [
      ["overview", "", { width: 1280, height: 900 }],
      ["overview on a phone", "", { width: 390, height: 844 }],
      ["actuator", addressOf(WORN), { width: 1280, height: 900 }],
      ["actuator on a phone", addressOf(WORN), { width: 390, height: 844 }],
      ["evidence on a phone", addressOf(WORN, "evidence"), { width: 390, height: 844 }],
    ]) {
      test(`the page is accessible: ${name}, ${colorScheme}`, async () => {
        await stage.source.send({ do: "run", period: 20, open: WORN });
        page = await open(stage, hash, { colorScheme, viewport });
        await page.waitForSelector(hash ? ".summary canvas" : "table.overview tbody tr");
        assert.deepEqual(await barriers(page), []);
        assert.ok(await overflow(page) <= 0, "wider than the screen");
      });
    }
  }

  test("the disconnected page is accessible", async () => {
    page = await open(stage);
    await row(page, "rudder").waitFor();
    await stage.source.send({ do: "stop" });
    await page.waitForSelector(".banner.error.wide");
    assert.deepEqual(await barriers(page), []);
  });
});

describe("without messages", () => {
  test("a monitor without actuators is distinguished from a missing monitor", async () => {
    const stage = await Stage.open("--actuators", 0);
    const page = await open(stage);
    await page.waitForSelector("text=No test yet");
    await page.context().close();
    stage.close();
    const silent = await Stage.open("--actuators", 0, "--without", "playback_state", "health");
    const silentPage = await open(silent);
    await silentPage.waitForSelector("text=No actuator yet");
    await silentPage.context().close();
    silent.close();
  });
});

describe("playback of a recording", () => {
  test("pause, position and speed are sent to the player", async () => {
    const stage = await Stage.open("--without");
    const publish = (state) =>
      stage.source.send({ do: "playback", status: 0, rate: 2, ...state });
    await publish({ position: 100 });
    const page = await open(stage);
    await page.waitForSelector(".playback");
    const waitForRequest = async (check) => until("the request", async () =>
      (await stage.source.send({ do: "requests" })).requests.find(check));
    await page.getByRole("button", { name: "Pause" }).click();
    await waitForRequest(({ command, speed, seek }) => command === "pause" && speed === 2 && seek === null);
    await publish({ position: 101, status: 1 });
    await page.getByRole("button", { name: "Play" }).waitFor();
    await page.getByLabel("Speed").selectOption("5");
    await waitForRequest(({ command, speed }) => command === "pause" && speed === 5);
    await page.getByLabel("Position in the recording").focus();
    await page.keyboard.press("Home");
    await waitForRequest(({ seek }) => seek === 1_700_000_000_000_000_000);
    assert.match(await page.locator(".bag").innerText(), /wear_of_a_flap/);
    await page.context().close();
    stage.close();
  });

  test("a seek backwards hides everything after the position", async () => {
    const stage = await Stage.open("--without");
    const page = await open(stage);
    await row(page, "rudder").locator("text=OK").first().waitFor();
    await stage.source.send({ do: "playback", status: 1, rate: 1, position: 5, jumped: true });
    await until("no health", async () => (await levelShown(page, "rudder")) === "NO HEALTH");
    await page.context().close();
    stage.close();
  });
});
