// SPDX-License-Identifier: Apache-2.0
// The change of friction over the records of a joint, reduced to a few points for a sparkline.

import { FAULTS } from "./faults.ts";
import { type UnitHistory, type UnitTest, seconds } from "./messages.ts";

const MOST_RECORDS = 2000;
const MOST_POINTS = 48;
const WIDTH_90 = 1.645; // standard deviations to either end of a 90 % interval

const index = FAULTS.findIndex(({ name }) => name === "friction");
const { slope } = FAULTS[index]!;

/** Change of friction, averaged over consecutive records, oldest first [-]. */
export interface FrictionTrend {
  change: number[];
  low: number[]; // lower end of the 90 % interval, averaged likewise
  high: number[]; // upper end
}

interface Point {
  stamp: number; // [s]
  change: number;
  sigma: number;
}

/** Friction of the records of a unit; other values of its history are not stored. */
export class FrictionRecord {
  #decode?: () => UnitHistory;
  #additions: UnitHistory[] = []; // merged when the trend is computed
  #serial = "";
  #points: Point[] = [];

  /** Replace the history; it is decoded when the trend is computed. */
  replace(decode: () => UnitHistory): void {
    this.#decode = decode;
    this.#additions = [];
  }

  add(addition: UnitHistory): void {
    this.#additions.push(addition);
    if (this.#additions.length > MOST_RECORDS) this.#additions.shift();
  }

  forgetAfter(time: number): void {
    this.#merge();
    this.#points = this.#points.filter(({ stamp }) => stamp <= time);
  }

  trend(): FrictionTrend {
    this.#merge();
    const size = Math.ceil(this.#points.length / MOST_POINTS);
    const trend: FrictionTrend = { change: [], low: [], high: [] };
    for (let start = 0; start < this.#points.length; start += size) {
      const points = this.#points.slice(start, start + size);
      const mean = (read: (point: Point) => number) =>
        points.reduce((sum, point) => sum + read(point), 0) / points.length;
      trend.change.push(mean(({ change }) => change));
      trend.low.push(mean(({ change, sigma }) => change - WIDTH_90 * sigma));
      trend.high.push(mean(({ change, sigma }) => change + WIDTH_90 * sigma));
    }
    return trend;
  }

  #extend(addition: UnitHistory): void {
    if (addition.serial_number !== this.#serial) this.#points = [];
    this.#serial = addition.serial_number;
    const stamps = new Set(addition.tests.map(({ stamp }) => seconds(stamp)));
    const kept = this.#points.filter(({ stamp }) => !stamps.has(stamp));
    this.#points = [...kept, ...pointsOf(addition.tests)].slice(-MOST_RECORDS);
  }

  #merge(): void {
    if (this.#decode) {
      const { serial_number: serial, tests } = this.#decode();
      this.#decode = undefined;
      this.#serial = serial;
      this.#points = pointsOf(tests);
    }
    for (const addition of this.#additions) this.#extend(addition);
    this.#additions = [];
  }
}

function pointsOf(tests: UnitTest[]): Point[] {
  return tests.map((test) => ({
    stamp: seconds(test.stamp), change: slope * test.faults[index]!,
    sigma: slope * test.sigmas[index]!,
  })).filter(({ change, sigma }) => Number.isFinite(change) && Number.isFinite(sigma));
}
