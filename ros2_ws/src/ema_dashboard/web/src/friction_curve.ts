// SPDX-License-Identifier: Apache-2.0
// Columns of the picture of friction over speed.

import type { FrictionCurve } from "./messages.ts";

export interface Picture {
  /** Speed; healthy 95 % and 5 % and latest, backward then forward; latest outside the band. */
  columns: (number | null)[][];
  covered: number; // speeds of the latest record
  judged: number; // of these, speeds that the healthy records cover
  outside: number;
}

/** Columns of the plot. The directions are apart: no line leads from one to the other. */
export function picture(curve: FrictionCurve): Picture {
  const rows = Array.from(curve.speed, (speed, i) => ({
    speed, low: curve.healthy_low[i]!, high: curve.healthy_high[i]!, latest: curve.latest[i]!,
  }));
  const covered = rows.filter(({ latest }) => Number.isFinite(latest));
  const judged = covered.filter(({ low, high }) => Number.isFinite(low) && Number.isFinite(high));
  const isOutside = ({ latest, low, high }: (typeof rows)[number]) => latest < low || latest > high;
  const column = (of: (row: (typeof rows)[number]) => number) =>
    rows.map((row) => (Number.isFinite(of(row)) ? of(row) : null));
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
