// Columns of the picture of friction over speed.

import type { FrictionCurve } from "./messages.ts";

export interface Picture {
  columns: (number | null)[][]; // speed, healthy 95 % and 5 %, latest, latest outside the band
  covered: number; // speeds of the latest record
  judged: number; // of these, speeds that the healthy records cover
  outside: number;
}

/** Columns of the plot, with a gap between the directions. */
export function picture(curve: FrictionCurve): Picture {
  const rows = Array.from(curve.speed, (speed, i) => ({
    speed, low: curve.healthy_low[i]!, high: curve.healthy_high[i]!, latest: curve.latest[i]!,
  }));
  const covered = rows.filter(({ latest }) => Number.isFinite(latest));
  const judged = covered.filter(({ low, high }) => Number.isFinite(low) && Number.isFinite(high));
  const isOutside = ({ latest, low, high }: (typeof rows)[number]) => latest < low || latest > high;
  const forward = rows.findIndex(({ speed }) => speed > 0);
  if (forward > 0) rows.splice(forward, 0, { speed: 0, low: NaN, high: NaN, latest: NaN });
  const column = (of: (row: (typeof rows)[number]) => number) =>
    rows.map((row) => (Number.isFinite(of(row)) ? of(row) : null));
  return {
    columns: [
      rows.map(({ speed }) => speed), column(({ high }) => high), column(({ low }) => low),
      column(({ latest }) => latest), column((row) => (isOutside(row) ? row.latest : NaN)),
    ],
    covered: covered.length,
    judged: judged.length,
    outside: judged.filter(isOutside).length,
  };
}
