// SPDX-License-Identifier: Apache-2.0
// Tests of the page's computations, without a browser.

import assert from "node:assert/strict";
import { mock, test } from "node:test";
import { load } from "./sources.mjs";

const format = await load("format.ts");
const faults = await load("faults.ts");
const { Telemetry } = await load("telemetry.ts");
const { UnitRecord, newHistoryNotice } = await load("unit_history.ts");
const { levelNow } = await load("levels.ts");
const { actuatorOf } = await load("peek.ts");
const { rowsOf } = await load("quantities.ts");
const { State, isOf } = await load("state.ts");
const joints = await load("joints.ts");
const { FrictionRecord } = await load("friction_trend.ts");
const { picture } = await load("friction_curve.ts");

test("a value is rounded according to its sigma", () => {
  assert.equal(format.withSigma(0.24893, 0.0018), "0.2489 ± 0.0018");
  assert.equal(format.withSigma(0.24893, 0.0042), "0.249 ± 0.004");
  assert.equal(format.withSigma(16.42, 0.33), "16.4 ± 0.3");
  assert.equal(format.withSigma(1234.5, 25), "1235 ± 25");
  assert.equal(format.withSigma(-0.02, 0.01), "−0.020 ± 0.010");
  assert.equal(format.withSigma(0.25, NaN), "0.250");
  assert.equal(format.withSigma(NaN, 0.1), "–");
});

test("a record has a row per quantity, with the same texts as the commands", () => {
  const row = (fields) => rowsOf([{
    name: "friction", judgement: 1, change: 0.152, low: 0.112, high: 0.192, smallest_change: 0.06,
    unit: "-", reason: "", rivals: [], ...fields,
  }])[0];
  assert.deepEqual(row({}), {
    name: "friction", label: "Coulomb friction", change: "+15.2 %", interval: "+11.2 to +19.2 %",
    judgement: "changed", isChanged: true,
  });
  assert.equal(row({ judgement: 0 }).judgement, "unchanged (changes above 6 % would show)");
  assert.equal(row({ judgement: 0, smallest_change: 0.138 }).judgement,
    "unchanged (changes above 14 % would show)");
  const hidden = row({ judgement: 2, change: -0.18, reason: "one direction only",
    rivals: ["torque_per_ampere"] });
  assert.equal(hidden.judgement, "not judged (one direction only)");
  // Values that a rival quantity may explain are hidden; the values of an uncertain change are shown.
  assert.deepEqual([hidden.change, hidden.interval], ["", ""]);
  const doubtful = row({ judgement: 2, change: 0.152, reason: "not certain" });
  assert.deepEqual([doubtful.change, doubtful.interval], ["+15.2 %", "+11.2 to +19.2 %"]);
  assert.equal(row({ rivals: ["torque_per_ampere"] }).judgement,
    "changed (not distinguishable from torque per unit of effort)");
  assert.equal(row({ name: "load", unit: "N.m", change: -0.5, smallest_change: 0.1 }).change, "−0.50 N.m");
  assert.equal(row({ name: "viscous_friction" }).label,
    "viscous friction (of all friction at the usual speed)");
  assert.deepEqual(rowsOf(undefined), []);
});

const quantity = (fields) => ({
  name: "friction", judgement: 1, change: 0.3, low: 0.25, high: 0.35, smallest_change: 0.06,
  unit: "-", reason: "", rivals: [], ...fields,
});

test("joints are grouped by robot, and robots and joints are sorted from worst to best", () => {
  const ranks = { "a/1": 3, "a/2": 1, "a/10": 3, "b/1": 0, "b/2": 3, lone: 2.7, "c/x/1": 1, "c/x/2": 1 };
  const units = Object.keys(ranks).map((id) => ({ namespace: "/ema", id, key: `/ema/${id}`, serial: "" }));
  const robots = joints.robotsOf(units, ({ id }) => ranks[id]);
  // A robot with two warnings comes before a robot with one.
  assert.deepEqual(robots.map(({ name }) => name), ["b", "c/x", "a", ""]);
  assert.deepEqual(robots[2].joints.map(({ id }) => id), ["a/2", "a/1", "a/10"]);
  const changed = (id, change, judgement = 1) => ({
    namespace: "/ema", id, key: `/ema/${id}`, serial: "",
    usable: { quantities: [quantity({ change, judgement })] },
  });
  // Only significant changes affect the order: noise must not.
  const [{ joints: sorted }] = joints.robotsOf(
    [changed("d/1", 0.02, 0), changed("d/2", 0.04, 0), changed("d/3", 0.2), changed("d/4", 0.4)], () => 1);
  assert.deepEqual(sorted.map(({ id }) => id), ["d/4", "d/3", "d/1", "d/2"]);
  const two = joints.robotsOf(["/x", "/y"].map((namespace) => (
    { namespace, id: "elbow", key: `${namespace}/elbow`, serial: "" })), () => 3);
  assert.deepEqual(two.map(({ namespace }) => namespace), ["/x", "/y"]);
  assert.deepEqual(joints.namesOf("left/arm/elbow"), { robot: "left/arm", joint: "elbow" });
  assert.deepEqual(joints.namesOf("elbow"), { robot: "", joint: "elbow" });
});

test("a joint shows its friction, other changes and its temperature", () => {
  const usable = {
    quantities: [quantity({}), quantity({ name: "play", change: 0.002, unit: "rad" }),
      quantity({ name: "inertia", judgement: 0 })],
    measured: [{ name: "load_torque", value: 3, sigma: 1 }, { name: "winding_temperature", value: 31, sigma: 2 }],
  };
  const joint = { usable, estimate: usable };
  assert.equal(joints.frictionOf(joint).change, "+30.0 %");
  assert.deepEqual(joints.otherChanges(joint).map(({ name }) => name), ["play"]);
  assert.equal(joints.temperatureOf(joint).value, 31);
  assert.equal(joints.frictionOf({}), undefined);
  assert.equal(joints.temperatureOf({}), undefined);
  assert.equal(joints.isJoint({ description: { drive: 2 } }), true);
  assert.equal(joints.isJoint({ description: { drive: 0 } }), false);
  assert.equal(joints.isJoint({ baseline: {} }), true);
});

test("the progress of learning is described with the available values", () => {
  const status = (fields) => ({ state: 0, records: 4, records_needed: 0, days: 1,
    detectable_same_day: NaN, detectable_other_day: NaN, ...fields });
  assert.equal(joints.countsText(status({})), "4 records on 1 day");
  assert.equal(joints.countsText(status({ records_needed: 10, days: 2 })), "4 of 10 records on 2 days");
  assert.equal(joints.countsText(status({ records: 1 })), "1 record on 1 day");
  assert.equal(joints.countsText(status({ state: 1, records: 12, records_needed: 10 })), "12 records on 1 day");
  const text = (sameDay, otherDay) => joints
    .detectableText(status({ detectable_same_day: sameDay, detectable_other_day: otherDay })).replaceAll("\u00a0", " ");
  assert.equal(text(NaN, NaN), "");
  assert.equal(text(0.0821, 0.21), "friction changes above 8.2 % would show, above 21 % on another day");
  assert.equal(text(0.08, NaN), "friction changes above 8 % would show");
});

test("the friction trend follows a history: replaced, extended, and cut at a seek", () => {
  const record = (sec, friction, sigma = 0.01) => {
    const [faults, sigmas] = [new Float64Array(8).fill(NaN), new Float64Array(8).fill(NaN)];
    [faults[0], sigmas[0]] = [friction, sigma];
    return { stamp: { sec, nanosec: 0 }, faults, sigmas };
  };
  const history = (tests, serial_number = "1") => ({ serial_number, tests });
  const friction = new FrictionRecord();
  let decoded = 0;
  friction.replace(() => { decoded += 1; return history([record(1, 0.1), record(2, NaN), record(3, 0.2)]); });
  friction.add(history([record(3, 0.25), record(4, 0.3)]));
  assert.equal(decoded, 0, "decoded only when it is shown");
  const trend = friction.trend();
  // Friction 0.1 is 20 % above nominal; a record without friction has no point.
  assert.deepEqual(trend.change, [0.2, 0.5, 0.6]);
  assert.ok(Math.abs(trend.high[0] - trend.change[0] - 1.645 * 0.02) < 1e-12);
  friction.forgetAfter(3);
  assert.deepEqual(friction.trend().change, [0.2, 0.5]);
  assert.equal(decoded, 1);
  friction.add(history([record(9, 0.05)], "2"));
  assert.deepEqual(friction.trend().change, [0.1], "another unit");
  friction.replace(() => history(Array.from({ length: 2000 }, (_, i) => record(i, i / 2000))));
  const { change } = friction.trend();
  assert.ok(change.length > 24 && change.length <= 48, change.length);
  assert.ok(change.every((value, i) => !i || value > change[i - 1]));
});

test("friction over speed has no line between the directions, and counts speeds outside the band", () => {
  const { columns, covered, judged, outside } = picture({
    speed: Float64Array.of(-2, -1, 1, 2), healthy_low: Float64Array.of(-1.1, -1.1, 0.9, NaN),
    healthy_high: Float64Array.of(-0.9, -0.9, 1.1, NaN), latest: Float64Array.of(NaN, -1.5, 1, 1.2),
  });
  assert.deepEqual(columns, [
    [-2, -1, 1, 2],
    [-0.9, -0.9, null, null], [-1.1, -1.1, null, null], [null, -1.5, null, null],
    [null, null, 1.1, null], [null, null, 0.9, null], [null, null, 1, 1.2],
    [null, -1.5, null, null],
  ]);
  assert.deepEqual([covered, judged, outside], [3, 2, 1]);
});

test("an unknown drive is shown with the faults that records reveal, and with the recorded effort", () => {
  const description = (fields) => ({ drive: 2, effort_kind: 0, torque_constant: 1, gear_ratio: 1, lead: 0, ...fields });
  const shown = (unit) => faults.ASSESSED.map(({ name }) => name).filter((name) => faults.isShown(name, unit));
  assert.deepEqual(shown(description({})), ["friction", "backlash"]);
  assert.deepEqual(shown(description({ drive: 0 })), shown(undefined));
  assert.equal(shown(undefined).length, faults.ASSESSED.length);
  assert.deepEqual(faults.effortOf(description({})), { name: "current", unit: "A", scale: 1 });
  assert.deepEqual(faults.effortOf(description({ drive: 0, effort_kind: 1 })).unit, "A");
  assert.deepEqual(faults.effortOf(description({ effort_kind: 1, torque_constant: 0.05, gear_ratio: 0.01 })),
    { name: "torque", unit: "N.m", scale: 5 });
  const force = faults.effortOf(description({ effort_kind: 2, lead: 0.005 }));
  assert.deepEqual([force.name, force.unit], ["force", "N"]);
  assert.ok(Math.abs(force.scale - (2 * Math.PI) / 0.005) < 1e-9);
});

test("faults of a linear actuator are also shown in N and mm", () => {
  const screw = {
    lead: 0.005, gear_ratio: 0.1, backlash: 0.08 * Math.PI, drive: 0,
    motor_static_friction: 0, user_static_friction: (200 * 0.0005) / (2 * Math.PI),
  };
  const text = (name, value, unit) => faults.physical(faults.faultOf(name), value, 0.01, unit);
  assert.match(text("friction", 0.25, screw), /× nominal, \+100\.0 N$/);
  assert.match(text("backlash", 0.1, screw), /× nominal, \+0\.198 mm$/);
  assert.match(text("friction", 0.25, { ...screw, drive: 2 }), /× nominal$/);
  assert.match(text("friction", 0.25, { ...screw, lead: 0 }), /× nominal$/);
});

test("hours of remaining life are rounded according to their interval", () => {
  const life = { hours_05: 1012.3, hours_50: 1623.7, hours_95: 2717.9 };
  assert.equal(format.lifeHours(life.hours_50, life), "1,620");
  const short = { hours_05: 3.21, hours_50: 5.43, hours_95: 8.76 };
  assert.equal(format.lifeHours(short.hours_50, short), "5.4");
  assert.equal(format.lifeHours(Infinity, life), "∞");
});

test("durations are shown in their two largest units", () => {
  assert.deepEqual(
    [0.4, 59, 61, 3600 * 2 + 300, 86_400 * 3 + 3600 * 4].map(format.duration),
    ["0 s", "59 s", "1 min 1 s", "2 h 5 min", "3 d 4 h"],
  );
});

function block(start, values, first = 0n, period = 0.01) {
  const column = Float64Array.from(values);
  return {
    header: { stamp: { sec: Math.floor(start), nanosec: Math.round((start % 1) * 1e9) } },
    sample_period: period, first_index: first,
    command: column, current: column, position: column, speed: column,
  };
}

test("thinned telemetry keeps the smallest and largest value of each slot, and gaps", () => {
  const telemetry = new Telemetry();
  const values = Array.from({ length: 100 }, (_, i) => Math.sin(i));
  values[41] = 50;
  values[42] = -70;
  telemetry.add(block(1000, values, 0n, 0.001));
  telemetry.add(block(1000.5, values, 500n, 0.001));
  const { time, values: { current } } = telemetry.signals();
  const finite = [...current].filter((value) => !Number.isNaN(value));
  assert.equal(Math.max(...finite), 50);
  assert.equal(Math.min(...finite), -70);
  // 0.1 s of samples, a gap of 0.4 s, 0.1 s of samples: at most 12 slots of 20 ms have values.
  assert.ok(finite.length <= 24 && finite.length >= 20, String(finite.length));
  assert.ok(time.at(-1) <= 0.02 && time[0] >= -10.02);
});

test("telemetry without current or speed shows the other columns", () => {
  const telemetry = new Telemetry();
  telemetry.add({ ...block(1000, [5, 6, 7]), current: new Float64Array(), speed: new Float64Array() });
  assert.ok(!telemetry.isEmpty);
  const { values } = telemetry.signals();
  const countFinite = (column) => [...column].filter((value) => !Number.isNaN(value)).length;
  assert.deepEqual([values.current, values.speed].map(countFinite), [0, 0]);
  assert.ok(countFinite(values.position) > 0);
});

test("telemetry that goes back in time replaces earlier telemetry", () => {
  const telemetry = new Telemetry();
  telemetry.add(block(1000, [5, 5, 5]));
  telemetry.add(block(900, [1, 1, 1]));
  const finite = [...telemetry.signals().values.current].filter((value) => !Number.isNaN(value));
  assert.deepEqual([...new Set(finite)], [1]);
});

function unitHistory(...seconds) {
  return {
    serial_number: "1", omitted: 7n, events: [],
    tests: seconds.map((sec) => ({
      stamp: { sec, nanosec: 5 }, flight_hours: sec / 10, cycles: 1n, verdict: 0,
      faults: new Float64Array(8), sigmas: new Float64Array(8), insignificant: 0, level: 0,
      health_index: 1, dominant_fault: "", rul_known: false, rul_05: NaN, rul_50: NaN, rul_95: NaN,
    })),
  };
}

test("added tests follow the tests sent by the node, without duplicates", () => {
  const record = new UnitRecord();
  record.replace(() => unitHistory(100, 200));
  record.add(unitHistory(200));
  record.add(unitHistory(300));
  const repeated = unitHistory(300); // the same test, once its level is known
  repeated.tests[0].level = 1;
  record.add(repeated);
  const columns = record.columns();
  assert.deepEqual([...columns.hours], [10, 20, 30]);
  assert.deepEqual([...columns.level], [0, 0, 1]);
  assert.equal(columns.omitted, 7);
  record.add({ ...unitHistory(400), serial_number: "2" });
  assert.deepEqual([...record.columns().hours], [40]);
});

test("a seek discards everything after the position", () => {
  const record = new UnitRecord();
  record.replace(() => unitHistory(100, 200, 300));
  record.forgetAfter(250);
  assert.deepEqual([...record.columns().hours], [10, 20]);
});

test("an event is shown once, with the kind and text sent by the node", () => {
  const event = (sec, kind, text) => ({ stamp: { sec, nanosec: 5 }, flight_hours: 1, kind, text });
  const record = new UnitRecord();
  const stored = unitHistory(100, 200);
  stored.events.push(event(200, "step", "friction rose"));
  record.replace(() => stored);
  const gap = event(300, "gap", "5 samples of telemetry missing");
  record.add({ ...unitHistory(), events: [gap, event(200, "step", "friction rose")] });
  assert.deepEqual(record.columns().events.map(({ kind, text }) => [kind, text]),
    [["step", "friction rose"], ["gap", "5 samples of telemetry missing"]]);
});

test("the actuator of a message is read without decoding the message", () => {
  const bytes = [0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0,
    ...Buffer.from("flap\0")];
  const view = (list) => new DataView(Uint8Array.from(list).buffer);
  assert.equal(actuatorOf(view(bytes)), "flap");
  assert.equal(actuatorOf(view(bytes.slice(0, 26))), undefined);
  assert.equal(actuatorOf(view(bytes.slice(0, 8))), undefined);
});

test("levels are unknown while the dashboard is silent", () => {
  mock.timers.enable({ apis: ["Date", "setTimeout"], now: 1e12 });
  globalThis.requestAnimationFrame = () => {};
  const state = new State(() => {});
  const receive = (topic, message) =>
    state.take({ kind: "messages", received: [{ namespace: "/ema", topic, message }] });
  const stamp = { sec: 1, nanosec: 0 };
  const status = (name) => receive("/diagnostics", {
    header: { stamp }, status: [{ name, level: 0, message: "", hardware_id: "", values: [] }],
  });
  const flap = () => [...state.actuators.values()][0];
  receive("health", { header: { stamp }, actuator_id: "flap", serial_number: "1",
    level: 1, last_level: 1, faults: [], requirements: [] });
  mock.timers.tick(4000);
  status("/ema/dashboard: dashboard");
  mock.timers.tick(4000);
  assert.equal(flap().isSilent ?? false, false);
  mock.timers.tick(2000);
  assert.equal(flap().isSilent, true);
  status("/ema/dashboard: dashboard");
  assert.equal(flap().isSilent, false);
  delete globalThis.requestAnimationFrame;
  mock.timers.reset();
});

test("an alarm of a silent monitor remains, marked as old", () => {
  const now = (...args) => { const { word, name, isOld } = levelNow(...args); return [word, name, isOld]; };
  assert.deepEqual(now(2, 2), ["ERROR", "error", undefined]);
  assert.deepEqual(now(3, 2), ["ERROR, old", "error", true]); // the monitor is silent
  assert.deepEqual(now(2, 2, true), ["ERROR, old", "error", true]); // the dashboard is silent
  assert.deepEqual(now(3, 1), ["WARN, old", "warn", true]);
  // An unknown level is never shown as OK.
  assert.deepEqual(now(0, 0, true), ["STALE", "stale", undefined]);
  assert.deepEqual(now(3, 0), ["STALE", "stale", undefined]);
  assert.deepEqual(now(3, 3), ["STALE", "stale", undefined]);
});

test("a lost history is reported until the new history has as many tests", () => {
  const event = (kind, text, count = 0) => ({ kind, text, count, stamp: { sec: 50, nanosec: 0 } });
  const loss = event("history", "the monitor started a new history", 3);
  const warning = (events, ...stamp) => newHistoryNotice({ events, stamp: Float64Array.from(stamp) });
  assert.equal(warning([loss, event("note", "Ada: seen")], 10, 20, 30, 50, 60), loss.text);
  assert.equal(warning([loss], 50, 60, 70), "");
  assert.equal(warning([event("history", "the file is damaged")], 10), "");
});

test("a status belongs to the actuator in its namespace", () => {
  const flap = { namespace: "/left", id: "flap" };
  const status = (name, hardware_id) => ({ name, hardware_id, level: 0, message: "", values: [] });
  assert.ok(isOf(flap, status("/left/monitor: flap health", "/left/flap")));
  assert.ok(isOf(flap, status("/left/monitor: flap backlash", "/left/flap/SIM-0001")));
  assert.ok(!isOf(flap, status("/left/monitor: flaperon health", "/left/flaperon/SIM-0001")));
  assert.ok(!isOf(flap, status("/right/monitor: flap health", "/right/flap/SIM-0001")));
  assert.ok(!isOf(flap, status("/left/flap/monitor: tab health", "/left/flap/tab/SIM-0001")));
  assert.ok(isOf({ namespace: "", id: "flap" }, status("/monitor: flap health", "/flap")));
});
