// SPDX-License-Identifier: Apache-2.0
// The history of each unit: the history sent by the node, and later additions.

import { type UnitEvent, type UnitHistory, type UnitTest, seconds } from "./messages.ts";
import { FAULTS } from "./faults.ts";

const MOST_TESTS = 2000;
const MOST_EVENTS = 500;

/** The tests of a unit by column, so that thousands can be transferred and drawn quickly. */
export interface HistoryColumns {
  serial: string;
  omitted: number;
  stamp: Float64Array; // [s]
  hours: Float64Array;
  faults: Float64Array[]; // one array per component
  sigmas: Float64Array[];
  insignificant: Uint32Array; // bits
  level: Uint8Array;
  health_index: Float64Array;
  rul_05: Float64Array;
  rul_50: Float64Array;
  rul_95: Float64Array;
  events: UnitEvent[];
}

export class UnitRecord {
  #encoded?: () => UnitHistory; // decoded when first shown
  #additions: UnitHistory[] = [];
  #serial = "";
  #omitted = 0;
  #tests: UnitTest[] = [];
  #events: UnitEvent[] = [];

  /** Replace the history by the node's history. */
  replace(decode: () => UnitHistory): void {
    this.#encoded = decode;
    this.#additions = [];
  }

  /** Store an addition to the history; it is merged when the history is shown. */
  add(addition: UnitHistory): void {
    this.#additions.push(addition);
    if (this.#additions.length > MOST_TESTS) this.#additions.shift();
  }

  /** Discard entries later than a time [s], after a seek in a recording. */
  forgetAfter(time: number): void {
    this.#merge();
    this.#tests = this.#tests.filter((test) => seconds(test.stamp) <= time);
    this.#events = this.#events.filter((event) => seconds(event.stamp) <= time);
  }

  columns(): HistoryColumns {
    this.#merge();
    const tests = this.#tests;
    const column = (read: (test: UnitTest) => number) => Float64Array.from(tests, read);
    const life = (read: (test: UnitTest) => number) =>
      column((test) => (test.rul_known ? read(test) : NaN));
    return {
      serial: this.#serial,
      omitted: this.#omitted,
      stamp: column((test) => seconds(test.stamp)),
      hours: column((test) => test.flight_hours),
      faults: FAULTS.map((_, k) => column((test) => test.faults[k]!)),
      sigmas: FAULTS.map((_, k) => column((test) => test.sigmas[k]!)),
      insignificant: Uint32Array.from(tests, (test) => test.insignificant),
      level: Uint8Array.from(tests, (test) => test.level),
      health_index: column((test) => test.health_index),
      rul_05: life((test) => test.rul_05),
      rul_50: life((test) => test.rul_50),
      rul_95: life((test) => test.rul_95),
      events: [...this.#events]
        .sort((a, b) => seconds(a.stamp) - seconds(b.stamp)),
    };
  }

  #merge(): void {
    if (this.#encoded) {
      const base = this.#encoded();
      this.#encoded = undefined;
      this.#tests = base.tests;
      this.#events = base.events;
      this.#serial = base.serial_number;
      this.#omitted = Number(base.omitted);
    }
    for (const addition of this.#additions) this.#extend(addition);
    this.#additions = [];
  }

  /** Add tests, replacing tests with the same stamp, and new events. */
  #extend(addition: UnitHistory): void {
    if (this.#serial !== addition.serial_number) this.#tests = [];
    this.#serial = addition.serial_number;
    const stamps = new Set(addition.tests.map((test) => seconds(test.stamp)));
    const tests = this.#tests.filter((test) => !stamps.has(seconds(test.stamp)));
    tests.push(...addition.tests);
    this.#tests = tests.slice(-MOST_TESTS);
    this.#omitted += tests.length - this.#tests.length;
    const keys = new Set(this.#events.map(identityOf));
    const events = addition.events.filter((event) => !keys.has(identityOf(event)));
    this.#events = [...this.#events, ...events].slice(-MOST_EVENTS);
  }
}

/** Return the notice of a new history until it has as many tests as were lost; else "". */
export function newHistoryNotice({ events, stamp }: HistoryColumns): string {
  const event = events.findLast(({ kind, count }) => kind === "history" && count > 0);
  if (!event) return "";
  const tests = stamp.filter((time) => time >= seconds(event.stamp)).length;
  return tests < event.count ? event.text : "";
}

function identityOf(event: UnitEvent): string {
  return `${event.stamp.sec}.${event.stamp.nanosec} ${event.kind} ${event.text}`;
}
