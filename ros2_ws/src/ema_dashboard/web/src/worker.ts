// SPDX-License-Identifier: Apache-2.0
// Connection, decoding and downsampling run here, so that the page itself only draws.

import { UNKNOWN_DRIVE } from "./faults.ts";
import { FrictionRecord, type FrictionTrend } from "./friction_trend.ts";
import { Link } from "./link.ts";
import {
  type ActuatorDescription, type DiagnosticArray, type PlaybackState, type TelemetryBlock, type UnitHistory, seconds,
} from "./messages.ts";
import { actuatorOf } from "./peek.ts";
import { type Address, type FromWorker, type Received, type ToWorker, keyOf } from "./protocol.ts";
import { Telemetry } from "./telemetry.ts";
import { UnitRecord } from "./unit_history.ts";

const BATCH_MS = 50; // 20 Hz
const MOST_TRENDS_MS = 10; // per batch
const MOST_ADDED = 16 * 1024; // size of an addition to a history [B]

const OF_ALL = new Set([
  "health", "fault_estimate", "health_forecast", "advice", "unit_history", "actuator_description",
  "baseline", "playback_state",
]);
const OF_THE_OPEN = new Set(["telemetry", "window_fit", "friction_curve"]);
const OF_THE_SYSTEM = new Set(["/diagnostics", "/clock"]);

let watched: Address | null = null;
let telemetry = new Telemetry();
let hasNewTelemetry = false;
let hasNewHistory = false;
let received: Received[] = [];
let clock: Received | undefined;
const records = new Map<string, UnitRecord>();
const frictions = new Map<string, FrictionRecord>();
const joints = new Set<string>();
const changedTrends = new Set<string>();

const post = (message: FromWorker, transfer: Transferable[] = []) =>
  (self as unknown as Worker).postMessage(message, transfer);

function split(topic: string): [string, string] {
  const at = topic.lastIndexOf("/");
  return [topic.slice(0, at), topic.slice(at + 1)];
}

function entryOf<T>(entries: Map<string, T>, key: string, create: new () => T): T {
  let entry = entries.get(key);
  if (!entry) {
    entry = new create();
    entries.set(key, entry);
  }
  return entry;
}

/** Store a history: decode additions now, and long histories when they are first shown. */
function extend(key: string, size: number, decode: () => UnitHistory): void {
  changedTrends.add(key);
  const history = size > MOST_ADDED ? undefined : decode();
  for (const record of [
    entryOf(records, key, UnitRecord), entryOf(frictions, key, FrictionRecord),
  ]) {
    if (!history) record.replace(decode);
    else if (history.is_addition) record.add(history);
    else record.replace(() => history);
  }
}

function isWatched(key: string): boolean {
  return watched !== null && keyOf(watched) === key;
}

// Relative to this script, because a proxy may serve the page under another path.
const link = new Link(new URL(".", self.location.href.replace(/^http/, "ws")).href, {
  wants(topic) {
    const [namespace, name] = split(topic);
    if (OF_THE_SYSTEM.has(topic) || OF_ALL.has(name)) return true;
    return watched?.namespace === namespace && OF_THE_OPEN.has(name);
  },
  message(topic, data, decode) {
    if (topic === "/clock") {
      clock = { namespace: "", topic, message: decode() };
      return;
    }
    if (topic === "/diagnostics") {
      received.push({ namespace: "", topic, message: decode() as DiagnosticArray });
      return;
    }
    const [namespace, name] = split(topic);
    if (name === "playback_state") {
      const message = decode() as PlaybackState;
      if (message.jumped) jump(seconds(message.position));
      received.push({ namespace, topic: name, message });
      return;
    }
    const id = actuatorOf(data);
    if (id === undefined) return;
    const key = keyOf({ namespace, id });
    if (OF_THE_OPEN.has(name) && !isWatched(key)) return;
    if (name === "telemetry") {
      telemetry.add(decode() as TelemetryBlock);
      hasNewTelemetry = true;
    } else if (name === "unit_history") {
      extend(key, data.byteLength, () => decode() as UnitHistory);
      hasNewHistory ||= isWatched(key);
    } else {
      const message = decode();
      const isJoint = name === "baseline" || name === "actuator_description" &&
        (message as ActuatorDescription).drive === UNKNOWN_DRIVE;
      if (isJoint) joints.add(key);
      received.push({ namespace, topic: name, message });
    }
  },
  channels: (topics) => post({ kind: "channels", topics }),
  connection: (connection) => post({ kind: "connection", connection }),
  session() {
    received = [];
    records.clear();
    frictions.clear();
    joints.clear();
    changedTrends.clear();
    telemetry = new Telemetry();
    post({ kind: "session" });
  },
});

function jump(time: number): void {
  telemetry = new Telemetry();
  for (const record of records.values()) record.forgetAfter(time);
  for (const key of joints) {
    frictions.get(key)?.forgetAfter(time);
    if (frictions.has(key)) changedTrends.add(key);
  }
  hasNewHistory = true;
}

/** Trends of joints that have changed, up to a time limit; the rest follows in the next batches. */
function trends(): Map<string, FrictionTrend> {
  const computed = new Map<string, FrictionTrend>();
  const start = performance.now();
  for (const key of changedTrends) {
    if (performance.now() - start > MOST_TRENDS_MS) break;
    if (!joints.has(key)) continue;
    changedTrends.delete(key);
    computed.set(key, frictions.get(key)!.trend());
  }
  return computed;
}

function flush(): void {
  if (clock) {
    received.push(clock);
    clock = undefined;
  }
  if (received.length) post({ kind: "messages", received });
  received = [];
  const changed = trends();
  if (changed.size) post({ kind: "trends", trends: changed });
  if (!watched) return;
  const key = keyOf(watched);
  if (hasNewHistory && records.has(key)) {
    post({ kind: "history", key, columns: records.get(key)!.columns() });
    hasNewHistory = false;
  }
  if (hasNewTelemetry && !telemetry.isEmpty) {
    const signals = telemetry.signals();
    const buffers = [signals.time, ...Object.values(signals.values)].map((values) => values.buffer);
    post({ kind: "live", key, signals }, buffers as ArrayBuffer[]);
    hasNewTelemetry = false;
  }
}

self.onmessage = ({ data }: MessageEvent<ToWorker>) => {
  switch (data.kind) {
    case "watch":
      // Unsubscribe first, so that the node sends the last window of the new actuator.
      watched = null;
      link.update();
      watched = data.address;
      telemetry = new Telemetry();
      hasNewHistory = true;
      link.update();
      break;
    case "play":
      link.control(data.play, data.rate, data.seek);
      break;
    case "retry":
      link.open();
      break;
  }
};

setInterval(flush, BATCH_MS);
link.open();
