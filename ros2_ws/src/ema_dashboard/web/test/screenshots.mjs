// SPDX-License-Identifier: Apache-2.0
// Take screenshots of every state of the page, in both themes: node test/screenshots.mjs FOLDER [NAMES...]

import { mkdir } from "node:fs/promises";
import path from "node:path";
import { randomFleet } from "./fleet.mjs";
import { Stage, launchBrowser } from "./stage.mjs";

const [folder, ...names] = process.argv.slice(2);
if (!folder) throw new Error("usage: node test/screenshots.mjs FOLDER [NAMES...]");
await mkdir(folder, { recursive: true });

const DESKTOP = { width: 1440, height: 900 };
const PHONE = { width: 390, height: 844 };
const NARROW = { width: 320, height: 640 };
const ROBOTS = ["--actuators", 2, "--joints", 14];
const ELBOW = "#/actuator/%2Fema/left%2Felbow";
const WORN = "#/actuator/%2Fema/left_outboard_flap";

const live = (options) => async (stage) => stage.source.send({ do: "run", period: 30, ...options });
const rows = (page) => page.waitForSelector("table.overview tbody tr");
const plots = (page) => page.waitForSelector(".plots.many canvas");
const sparklines = async (page) => {
  await page.waitForSelector(".sparkline");
  await page.waitForSelector(".joint.learning");
};
const refuseBaseline = async (page) => {
  await page.getByRole("button", { name: "Accept", exact: true }).click();
  await page.fill("form.change [name=person]", "Ada Lovelace");
  await page.getByRole("button", { name: "Accept the baseline" }).click();
  await page.waitForSelector("form.change [role=alert]");
};
const archived = async (stage) => { stage.origin.fleet = randomFleet(); await live({})(stage); };
const curve = (page) => page.waitForSelector("[aria-labelledby=survival] canvas");

const STATES = [
  { name: "actuator", hash: WORN, before: live({}), ready: plots,
    view: { width: 1440, height: 1004 }, scale: 1 },
  { name: "overview", before: live({}), ready: rows },
  { name: "overview_phone", before: live({}), ready: rows, view: PHONE },
  { name: "archive", hash: "#/archive", before: archived, ready: curve, full: true },
  { name: "archive_phone", hash: "#/archive", before: archived, ready: curve, view: PHONE, full: true },
  ...["faults", "life", "test", "evidence", "telemetry", "events"].flatMap((part) =>
    [{}, { view: PHONE }].map((view) => ({
      name: `${part}${view.view ? "_phone" : ""}`, hash: `${WORN}/${part}`, full: true, ...view,
      before: live({ open: "left_outboard_flap" }),
      ready: async (page) => {
        await page.waitForSelector(".summary canvas");
        if (part === "telemetry") await page.waitForTimeout(2500);
      },
    }))),
  ...[{}, { view: PHONE }, { view: NARROW }].flatMap((view, i) => [
    { name: `joints${["", "_phone", "_narrow"][i]}`, options: ROBOTS, ready: sparklines, full: true,
      ...view },
    { name: `joint${["", "_phone", "_narrow"][i]}`, options: ROBOTS, hash: ELBOW, full: true, ...view,
      ready: (page) => page.waitForSelector("[aria-labelledby=friction] canvas") },
    { name: `learning${["", "_phone", "_narrow"][i]}`, options: ROBOTS, full: true, ...view,
      hash: "#/actuator/%2Fema/left%2Fwrist_3", ready: refuseBaseline },
  ]),
  { name: "joints_table", options: ROBOTS, ready: async (page) => {
    await sparklines(page);
    await page.getByRole("button", { name: "table" }).click();
    await rows(page);
  } },
  { name: "joints_60", options: ["--actuators", 0, "--joints", 60], ready: sparklines },
  { name: "failed", hash: "#/actuator/%2Fema/right_outboard_flap", before: live({}), ready: plots },
  { name: "refused", hash: WORN, ready: async (page, stage) => {
    await plots(page);
    await stage.source.send({ do: "test", actuator: "left_outboard_flap",
      refused: "the calibration flap-2031 expired on 2031-04-02: calibrate the unit" });
    await page.waitForSelector(".head .banner.error");
  } },
  { name: "departed", hash: WORN, ready: async (page, stage) => {
    await plots(page);
    await stage.source.send({ do: "test", actuator: "left_outboard_flap", verdict: 5,
      refused: "current at rest +38 %, 6.1 sigma; no fault explains it" });
    await page.waitForSelector(".head .banner.warn");
  } },
  { name: "old", hash: "#/actuator/%2Fema/right_outboard_flap", ready: async (page, stage) => {
    await plots(page);
    await stage.source.send({ do: "set", actuator: "right_outboard_flap", level: 3 });
    await page.waitForSelector(".banner.stale");
  } },
  { name: "stale", hash: WORN, ready: async (page, stage) => {
    await plots(page);
    await stage.source.send({ do: "set", actuator: "left_outboard_flap", level: 3 });
    await page.waitForSelector(".banner.stale");
  } },
  { name: "disconnected", before: live({}), ready: async (page, stage) => {
    await rows(page);
    stage.origin.isDown = true;
    stage.origin.disconnect();
    await page.waitForSelector(".banner.error.wide");
  } },
  { name: "silent", before: live({}), ready: async (page, stage) => {
    await rows(page);
    await stage.source.send({ do: "halt" });
    await page.waitForSelector(".banner.warn.wide");
  } },
  { name: "empty", options: ["--actuators", 0], before: live({}),
    ready: (page) => page.waitForSelector("text=No test yet") },
  { name: "nothing", options: ["--actuators", 0, "--without", "playback_state", "health"],
    ready: (page) => page.waitForSelector("text=No actuator yet") },
  { name: "connecting", before: async (stage) => { stage.origin.isHanging = true; },
    ready: (page) => page.waitForSelector(".loading") },
  { name: "not_allowed", before: async (stage) => { stage.origin.refusalStatus = 503; },
    ready: (page) => page.waitForSelector("text=Not allowed") },
  { name: "no_match", before: live({}), ready: async (page) => {
    await rows(page);
    await page.fill("input[type=search]", "winglet");
    await page.waitForSelector(".empty");
  } },
  { name: "playback", options: ["--without"], hash: WORN, before: async (stage) => {
    await stage.source.send({ do: "playback", status: 1, rate: 2, position: 210 });
  }, ready: async (page) => { await plots(page); await page.waitForSelector(".playback"); } },
];

const browser = await launchBrowser();
for (const state of STATES.filter(({ name }) => !names.length || names.includes(name))) {
  for (const colorScheme of ["light", "dark"]) {
    const stage = await Stage.open(...(state.options ?? []));
    await state.before?.(stage);
    const context = await browser.newContext({
      viewport: state.view ?? DESKTOP, colorScheme, deviceScaleFactor: state.scale ?? (state.view ? 2 : 1),
    });
    const page = await context.newPage();
    page.on("console", (entry) => {
      if (entry.type() === "error" && !/WebSocket|Failed to load/.test(entry.text())) {
        console.error(`${state.name}: ${entry.text()}`);
      }
    });
    page.on("pageerror", (error) => console.error(`${state.name}: ${error}`));
    await page.goto(stage.address + (state.hash ?? ""));
    await state.ready(page, stage);
    await page.waitForTimeout(500); // fonts and the plots' first drawing
    // Render elements outside the viewport, which a picture of the whole page includes.
    await page.$$eval(".joint, .overview tbody tr", (elements, isFull) => {
      for (const element of elements) if (isFull) element.style.contentVisibility = "visible";
    }, state.full ?? false);
    await page.evaluate(() => scrollTo(0, 0));
    await page.waitForTimeout(200);
    const file = path.join(folder, `${state.name}_${colorScheme}.png`);
    await page.screenshot({ path: file, fullPage: state.full ?? false });
    console.log(file);
    await context.close();
    stage.close();
  }
}
await browser.close();
