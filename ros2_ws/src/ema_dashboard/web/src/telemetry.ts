// SPDX-License-Identifier: Apache-2.0
// The last seconds of one actuator's telemetry, downsampled to the smallest and largest value of
// each time slot, so that no peak is lost.

import { seconds, type TelemetryBlock } from "./messages.ts";

export const SHOWN_S = 10;
const LEAST_SLOT_S = 0.02;
const SIGNALS = ["command", "position", "current", "speed"] as const;

export interface LiveSignals {
  end: number; // stamp of the latest sample [s]
  period: number; // sample period [s]
  time: Float64Array; // times of the values, relative to the latest sample [s]
  values: Record<(typeof SIGNALS)[number], Float64Array>;
}

export class Telemetry {
  #slot = 0;
  #period = 0;
  #first = 0; // number of the oldest stored slot
  #end = -Infinity;
  #count = 0;
  #low: Float64Array[] = [];
  #high: Float64Array[] = [];

  /** Add a block. A different sample period or a step back in time of over 1 s clears the signals. */
  add(block: TelemetryBlock): void {
    const start = seconds(block.header.stamp);
    const n = block.position.length;
    if (n === 0 || !(block.sample_period > 0)) return;
    if (block.sample_period !== this.#period || start < this.#end - 1) this.#reset(block, start);
    for (let i = 0; i < n; i++) {
      const slot = Math.floor((start + i * this.#period) / this.#slot);
      if (slot >= this.#first + this.#count) this.#advance(slot - this.#count + 1);
      const at = slot % this.#count;
      if (slot < this.#first) continue;
      for (let k = 0; k < SIGNALS.length; k++) {
        // The column of a quantity that is not measured is empty.
        const value = block[SIGNALS[k]!][i] ?? NaN;
        const [low, high] = [this.#low[k]!, this.#high[k]!];
        if (!(low[at]! <= value)) low[at] = value;
        if (!(high[at]! >= value)) high[at] = value;
      }
    }
    this.#end = Math.max(this.#end, start + (n - 1) * this.#period);
  }

  get isEmpty(): boolean {
    return this.#count === 0;
  }

  /** Signals with two values per slot, the lower first; NaN in slots without samples. */
  signals(): LiveSignals {
    const n = this.#count;
    const time = new Float64Array(2 * n);
    const values = SIGNALS.map(() => new Float64Array(2 * n));
    for (let i = 0; i < n; i++) {
      const slot = this.#first + i;
      time[2 * i] = slot * this.#slot - this.#end;
      time[2 * i + 1] = (slot + 0.5) * this.#slot - this.#end;
      for (let k = 0; k < SIGNALS.length; k++) {
        values[k]![2 * i] = this.#low[k]![slot % n]!;
        values[k]![2 * i + 1] = this.#high[k]![slot % n]!;
      }
    }
    const [command, position, current, speed] = values as [
      Float64Array, Float64Array, Float64Array, Float64Array,
    ];
    return {
      end: this.#end, period: this.#period, time, values: { command, position, current, speed },
    };
  }

  #reset(block: TelemetryBlock, start: number): void {
    this.#period = block.sample_period;
    this.#slot = Math.max(LEAST_SLOT_S, this.#period);
    this.#count = Math.ceil(SHOWN_S / this.#slot);
    this.#low = SIGNALS.map(() => new Float64Array(this.#count).fill(NaN));
    this.#high = SIGNALS.map(() => new Float64Array(this.#count).fill(NaN));
    this.#first = Math.floor(start / this.#slot) - this.#count + 1;
    this.#end = -Infinity;
  }

  #advance(first: number): void {
    const from = Math.max(this.#first, first - this.#count);
    for (let slot = from; slot < first; slot++) {
      for (const column of [...this.#low, ...this.#high]) column[slot % this.#count] = NaN;
    }
    this.#first = first;
  }
}
