// The history of each unit: what the node sent, and what has come live since then.

import {
  type FaultEstimate, type Health, type UnitEvent, type UnitHistory, type UnitTest, STALE, seconds,
} from "./messages.ts";
import { FAULTS } from "./faults.ts";

const MOST_TESTS = 2000;
const MOST_EVENTS = 500;

/** The tests of a unit by column, so that thousands are handed over and drawn at little cost. */
export interface HistoryColumns {
  serial: string;
  omitted: number;
  stamp: Float64Array; // [s]
  hours: Float64Array;
  faults: Float64Array[]; // one a component
  sigmas: Float64Array[];
  insignificant: Uint8Array;
  level: Uint8Array;
  health_index: Float64Array;
  rul_05: Float64Array;
  rul_50: Float64Array;
  rul_95: Float64Array;
  events: UnitEvent[];
}

export class UnitRecord {
  #encoded?: () => UnitHistory; // decoded when it is first shown
  #serial = "";
  #omitted = 0;
  #tests: UnitTest[] = [];
  #events: UnitEvent[] = [];
  #estimate?: FaultEstimate;

  /** Take over what the node knows; tests that came live and are later than it are kept. */
  replace(decode: () => UnitHistory): void {
    this.#encoded = decode;
  }

  /** Keep a valid estimate until its health comes. */
  estimated(estimate: FaultEstimate): void {
    if (estimate.valid) this.#estimate = estimate;
  }

  /** Add the test that this health follows from; return whether anything was added. */
  judged(health: Health): boolean {
    this.happened(health.events);
    const estimate = this.#estimate;
    const isOfEstimate = estimate !== undefined && health.level !== STALE &&
      estimate.serial_number === health.serial_number &&
      seconds(estimate.header.stamp) === seconds(health.header.stamp);
    if (!isOfEstimate) return health.events.length > 0;
    if (this.#serial && this.#serial !== health.serial_number) this.#tests = [];
    this.#serial = health.serial_number;
    const test = testOf(estimate, health);
    // Health is published again when the requirements have been computed.
    const last = this.#tests.at(-1);
    if (last && seconds(last.stamp) === seconds(test.stamp)) this.#tests.pop();
    this.#tests.push(test);
    if (this.#tests.length > MOST_TESTS) this.#omitted += this.#tests.shift() ? 1 : 0;
    return true;
  }

  /** Add events, each once; what is latched comes again. */
  happened(events: UnitEvent[]): void {
    if (events.length === 0) return;
    const known = new Set(this.#events.map(identityOf));
    this.#events = [...this.#events, ...events.filter((event) => !known.has(identityOf(event)))]
      .slice(-MOST_EVENTS);
  }

  /** Forget what is later than a time, after a seek in a recording. */
  forgetAfter(time: number): void {
    this.#merge();
    this.#tests = this.#tests.filter((test) => seconds(test.stamp) <= time);
    this.#events = this.#events.filter((event) => seconds(event.stamp) <= time);
    this.#estimate = undefined;
  }

  columns(): HistoryColumns {
    this.#merge();
    const tests = this.#tests;
    const column = (of: (test: UnitTest) => number) => Float64Array.from(tests, of);
    const life = (of: (test: UnitTest) => number) =>
      column((test) => (test.rul_known ? of(test) : NaN));
    return {
      serial: this.#serial,
      omitted: this.#omitted,
      stamp: column((test) => seconds(test.stamp)),
      hours: column((test) => test.flight_hours),
      faults: FAULTS.map((_, k) => column((test) => test.faults[k]!)),
      sigmas: FAULTS.map((_, k) => column((test) => test.sigmas[k]!)),
      insignificant: Uint8Array.from(tests, (test) => test.insignificant),
      level: Uint8Array.from(tests, (test) => test.level),
      health_index: column((test) => test.health_index),
      rul_05: life((test) => test.rul_05),
      rul_50: life((test) => test.rul_50),
      rul_95: life((test) => test.rul_95),
      events: [...this.#events]
        .sort((one, other) => seconds(one.stamp) - seconds(other.stamp)),
    };
  }

  #merge(): void {
    if (!this.#encoded) return;
    const base = this.#encoded();
    this.#encoded = undefined;
    const isSame = !this.#serial || this.#serial === base.serial_number;
    const known = new Set(base.tests.map((test) => seconds(test.stamp)));
    const end = base.tests.length ? seconds(base.tests.at(-1)!.stamp) : -Infinity;
    const later = isSame ? this.#tests.filter((test) =>
      !known.has(seconds(test.stamp)) && seconds(test.stamp) > end) : [];
    const said = new Set(base.events.map(identityOf));
    const added = this.#events.filter((event) => !said.has(identityOf(event)));
    this.#tests = [...base.tests, ...later].slice(-MOST_TESTS);
    this.#events = [...base.events, ...added]
      .sort((one, other) => seconds(one.stamp) - seconds(other.stamp)).slice(-MOST_EVENTS);
    this.#serial = base.serial_number;
    this.#omitted = Number(base.omitted);
  }
}

function identityOf(event: UnitEvent): string {
  return `${event.stamp.sec}.${event.stamp.nanosec} ${event.kind} ${event.text}`;
}

function testOf(estimate: FaultEstimate, health: Health): UnitTest {
  const faults = FAULTS.map(({ name }, k) =>
    (estimate.unobservable >> k) & 1 ? NaN : estimate.faults[name]!);
  const n = FAULTS.length;
  return {
    stamp: health.header.stamp,
    flight_hours: health.flight_hours,
    cycles: health.cycles,
    verdict: estimate.verdict,
    faults,
    sigmas: FAULTS.map((_, k) => Math.sqrt(estimate.covariance[k * n + k]!)),
    insignificant: estimate.insignificant,
    level: health.level,
    health_index: health.health_index,
    dominant_fault: health.dominant_fault,
    rul_known: health.rul.known,
    rul_05: health.rul.hours_05,
    rul_50: health.rul.hours_50,
    rul_95: health.rul.hours_95,
  };
}
