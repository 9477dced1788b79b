// SPDX-License-Identifier: Apache-2.0
// State of all actuators. Messages arrive in batches; views are updated at most five times per second.

import type { FrictionTrend } from "./friction_trend.ts";
import {
  type ActuatorDescription, type Advice, type BaselineStatus, type DiagnosticArray,
  type DiagnosticStatus, type FaultEstimate, type FrictionCurve, type Health, type HealthForecast,
  type PlaybackState, type WindowFit,
  PLAYING, seconds, type Time,
} from "./messages.ts";
import { type Address, type Connection, type FromWorker, type Received, keyOf } from "./protocol.ts";
import type { LiveSignals } from "./telemetry.ts";
import type { HistoryColumns } from "./unit_history.ts";

const LEAST_MS = 200; // between two updates of the views
const MOST_MS = 600;
const LEAST_IDLE = 8; // idle time between updates, relative to the latest update's duration
const CURRENT_S = 3; // largest age of a /clock message that counts as current
const SILENT_MS = 5000; // a dashboard publishes its status every second

/** Latest data of an actuator; replaced by a new object on each change. */
export interface Actuator extends Address {
  key: string;
  serial: string;
  description?: ActuatorDescription;
  health?: Health;
  estimate?: FaultEstimate; // the latest
  usable?: FaultEstimate; // the latest valid estimate
  forecast?: HealthForecast;
  advice?: Advice;
  fit?: WindowFit;
  baseline?: BaselineStatus; // of a joint
  curve?: FrictionCurve; // of the joint shown
  isSilent?: boolean; // no messages from the dashboard: the health may have changed
}

export interface Diagnostic extends DiagnosticStatus {
  stamp: number;
  received: number;
}

/** Namespace of the node of a status: `/ema` for `/ema/monitor: flap health`. */
export function namespaceOf({ name }: DiagnosticStatus): string {
  return /^([^:]*)\/[^/:]*: /.exec(name)?.[1] ?? "";
}

/** Whether a status concerns an actuator, whichever unit is installed. */
export function isOf(address: Address, status: DiagnosticStatus): boolean {
  const key = keyOf(address);
  return namespaceOf(status) === address.namespace &&
    (status.hardware_id === key || status.hardware_id.startsWith(`${key}/`));
}

export class State {
  connection: Connection = { state: "connecting" };
  topics: string[] | undefined;
  actuators = new Map<string, Actuator>();
  diagnostics = new Map<string, Diagnostic>();
  trends = new Map<string, FrictionTrend>(); // of joints
  playback?: PlaybackState;
  history?: { key: string; columns: HistoryColumns };
  lastReceived = 0; // local clock [ms]
  lostAt = 0; // when the connection was lost [ms]; 0 while connected

  #views = new Set<() => void>();
  #silence?: ReturnType<typeof setTimeout>;
  #live = new Set<(key: string, signals: LiveSignals) => void>();
  #isDue = false;
  #lastUpdate = -Infinity;
  #took = 0; // duration of the latest update [ms]
  #now = { stamp: 0, at: 0, isClock: false };

  /** Call a function after changes. Return a function that ends the subscription. */
  subscribe(view: () => void): () => void {
    this.#views.add(view);
    return () => this.#views.delete(view);
  }

  onLive(listener: (key: string, signals: LiveSignals) => void): () => void {
    this.#live.add(listener);
    return () => this.#live.delete(listener);
  }

  /** ROS time [s]; during a playback or simulation, its time. */
  now(): number {
    if (!this.#now.at) return Date.now() / 1000;
    const passed = (performance.now() - this.#now.at) / 1000;
    const isStill = this.playback !== undefined && this.playback.status !== PLAYING;
    if (this.#now.isClock) return this.#now.stamp + (isStill ? 0 : Math.min(passed, 1));
    return this.#now.stamp + passed;
  }

  take(message: FromWorker): void {
    switch (message.kind) {
      case "live":
        for (const listener of this.#live) listener(message.key, message.signals);
        return;
      case "connection":
        if (message.connection.state === "open") this.lostAt = 0;
        else if (this.connection.state === "open") this.lostAt = Date.now();
        this.connection = message.connection;
        break;
      case "session":
        this.actuators.clear();
        this.diagnostics.clear();
        this.trends.clear();
        this.playback = undefined;
        this.history = undefined;
        this.#now = { stamp: 0, at: 0, isClock: false };
        break;
      case "channels":
        this.topics = message.topics;
        if (!this.topics.some((topic) => topic.endsWith("/playback_state"))) {
          this.playback = undefined;
        }
        break;
      case "history":
        this.history = message;
        break;
      case "trends":
        for (const [key, trend] of message.trends) this.trends.set(key, trend);
        break;
      case "messages":
        this.lastReceived = Date.now();
        this.#listen();
        for (const item of message.received) this.#receive(item);
        break;
    }
    this.#changed();
  }

  #changed(): void {
    if (this.#isDue) return;
    this.#isDue = true;
    const pause = Math.min(Math.max(LEAST_MS, LEAST_IDLE * this.#took), MOST_MS);
    setTimeout(() => {
      this.#isDue = false;
      const start = performance.now();
      this.#lastUpdate = start;
      for (const view of this.#views) view();
      // Views render before the next frame; style and layout follow.
      requestAnimationFrame(() => setTimeout(() => { this.#took = performance.now() - start; }));
    }, Math.max(this.#lastUpdate + pause - performance.now(), 0));
  }

  #receive({ namespace, topic, message }: Received): void {
    if (topic === "/diagnostics") return this.#diagnosed(message as DiagnosticArray);
    if (topic === "/clock") return this.#clocked(seconds((message as { clock: Time }).clock));
    if (topic === "playback_state") return this.#played(message as PlaybackState);
    const unit = message as { actuator_id: string; serial_number?: string };
    const address = { namespace, id: unit.actuator_id };
    const key = keyOf(address);
    const before = this.actuators.get(key) ?? { ...address, key, serial: "" };
    const after: Actuator = { ...before };
    if (unit.serial_number) after.serial = unit.serial_number;
    switch (topic) {
      case "actuator_description":
        after.description = message as ActuatorDescription;
        break;
      case "health":
        after.health = message as Health;
        break;
      case "fault_estimate":
        after.estimate = message as FaultEstimate;
        if (after.estimate.valid) after.usable = after.estimate;
        break;
      case "health_forecast":
        after.forecast = message as HealthForecast;
        break;
      case "advice":
        after.advice = message as Advice;
        break;
      case "window_fit":
        after.fit = message as WindowFit;
        break;
      case "baseline":
        after.baseline = message as BaselineStatus;
        break;
      case "friction_curve":
        after.curve = message as FrictionCurve;
        break;
      default:
        return;
    }
    this.actuators.set(key, after);
  }

  #diagnosed(array: DiagnosticArray): void {
    const stamp = seconds(array.header.stamp);
    for (const status of array.status) {
      this.diagnostics.set(status.name, { ...status, stamp, received: Date.now() });
    }
    // During a playback, only the player's state gives the current time.
    if (this.playback) return;
    const passed = performance.now() - this.#now.at;
    if (!this.#now.isClock || passed > 1000 * CURRENT_S) {
      this.#now = { stamp, at: performance.now(), isClock: false };
    }
  }

  /** Mark all actuators as silent if no message arrives for some time. */
  #listen(): void {
    clearTimeout(this.#silence);
    this.#note(false);
    this.#silence = setTimeout(() => {
      this.#note(true);
      this.#changed();
    }, SILENT_MS);
  }

  #note(isSilent: boolean): void {
    for (const actuator of this.actuators.values()) {
      if (isSilent !== (actuator.isSilent ?? false)) {
        this.actuators.set(actuator.key, { ...actuator, isSilent });
      }
    }
  }

  #clocked(stamp: number): void {
    this.#now = { stamp, at: performance.now(), isClock: true };
  }

  #played(playback: PlaybackState): void {
    this.playback = playback;
    const position = seconds(playback.position);
    this.#clocked(position);
    if (!playback.jumped) return;
    // After a jump, discard messages later than the position.
    for (const actuator of this.actuators.values()) {
      const kept = <T extends { header: { stamp: Time } }>(message?: T) =>
        message && seconds(message.header.stamp) <= position ? message : undefined;
      this.actuators.set(actuator.key, {
        ...actuator,
        health: kept(actuator.health),
        estimate: kept(actuator.estimate),
        usable: kept(actuator.usable),
        forecast: kept(actuator.forecast),
        advice: kept(actuator.advice),
        fit: kept(actuator.fit),
        baseline: kept(actuator.baseline),
        curve: kept(actuator.curve),
      });
    }
  }
}
