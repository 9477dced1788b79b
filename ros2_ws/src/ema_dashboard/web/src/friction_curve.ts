// SPDX-License-Identifier: Apache-2.0
// Columns of the plot of friction over speed.

import type { FrictionCurve } from "./messages.ts";

export interface Picture {
  /**
   * Speed; upper end and lower end of the healthy band and latest record, each backward and then
   * forward; values of the latest record outside the band.
   */
  columns: (number | null)[][];
  covered: number; // number of speeds in the latest record
  judged: number; // number of these that the healthy records cover
  outside: number; // number of these outside the healthy band
}

/** Columns of the plot. Directions have separate columns, so that no line connects them. */
export function picture(curve: FrictionCurve): Picture {
  const rows = Array.from(curve.speed, (speed, i) => ({
    speed, low: curve.healthy_low[i]!, high: curve.healthy_high[i]!, latest: curve.latest[i]!,
  }));
  const covered = rows.filter(({ latest }) => Number.isFinite(latest));
  const judged = covered.filter(({ low, high }) => Number.isFinite(low) && Number.isFinite(high));
  const isOutside = ({ latest, low, high }: (typeof rows)[number]) => latest < low || latest > high;
  const column = (read: (row: (typeof rows)[number]) => number) =>
    rows.map((row) => (Number.isFinite(read(row)) ? read(row) : null));
  return {
    columns: [
      rows.map(({ speed }) => speed),
      ...[-1, 1].flatMap((sign) => (["high", "low", "latest"] as const).map((name) =>
        column((row) => (Math.sign(row.speed) === sign ? row[name] : NaN)))),
      column((row) => (isOutside(row) ? row.latest : NaN)),
    ],
    covered: covered.length,
    judged: judged.length,
    outside: judged.filter(isOutside).length,
  };
}
