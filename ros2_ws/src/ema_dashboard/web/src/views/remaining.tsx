// SPDX-License-Identifier: Apache-2.0
// Plot of the remaining life over service hours: past predictions and the present prediction.

import { useMemo } from "preact/hooks";
import type uPlot from "uplot";
import { hours as inHours, lifeHours } from "../format.ts";
import type { Health } from "../messages.ts";
import type { HistoryColumns } from "../unit_history.ts";
import { Empty, Section } from "./parts.tsx";
import { type Colour, Plot, upright } from "./plot.tsx";

export function Remaining({ health, columns }: { health?: Health; columns?: HistoryColumns }) {
  const built = useMemo(() => columns && assemble(columns, health), [columns, health]);
  const life = health?.rul;
  const isKnown = built !== undefined && built.count > 0;
  const note = life?.known ? `until ${life.criterion}; ${health!.assumption}` : undefined;
  const draw = (plot: uPlot, colour: Colour) => {
    if (life?.known) upright(plot, health!.flight_hours, "now", colour("ink-soft"));
  };
  const band = { points: { show: false }, value: (_: uPlot, v: number) => inHours(v) };
  const series: uPlot.Series[] = [
    { label: "median", stroke: "data", width: 2.5, ...band },
    { label: "5 %", stroke: "data", width: 0.7, ...band },
    { label: "95 %", stroke: "data", width: 0.7, ...band },
    { label: "median from now", stroke: "fan-line", width: 2, dash: [6, 5], ...band },
    { label: "5 % from now", stroke: "fan-line", width: 1, dash: [3, 4], ...band },
    { label: "95 % from now", stroke: "fan-line", width: 1, dash: [3, 4], ...band },
  ];
  return (
    <Section title="Remaining life over service hours" id="remaining" note={note}>
      {isKnown ? (
        <Plot label={plotText(health, built.count)} height={280} x="service hours [h]"
          y="remaining life [h]" series={series} data={built.data} legend={false}
          bands={[{ series: [3, 2], fill: "band" }, { series: [6, 5], fill: "fan" }]}
          yRange={() => [0, built.top]} draw={draw} />
      ) : (
        <Empty>
          {columns ? `The remaining life is unknown${life?.reason ? `: ${life.reason}` : "."}`
            : "Loading the history…"}
        </Empty>
      )}
    </Section>
  );
}

function plotText(health: Health | undefined, count: number): string {
  const life = health?.rul;
  if (!life?.known) return `Remaining life after ${count} tests; unknown now`;
  return `Remaining life after ${count} tests: now ${lifeHours(life.hours_50, life)} hours, ` +
    `5 to 95 % ${lifeHours(life.hours_05, life)} to ${lifeHours(life.hours_95, life)} hours`;
}

/** Prediction after each test, and three straight lines from now to the predicted ends of life. */
function assemble(columns: HistoryColumns, health?: Health) {
  const order = Array.from(columns.hours.keys())
    .filter((i) => Number.isFinite(columns.hours[i]!) && Number.isFinite(columns.rul_50[i]!))
    .sort((a, b) => columns.hours[a]! - columns.hours[b]!);
  const finite = (value: number) => (Number.isFinite(value) ? value : null);
  const life = health?.rul;
  const start = health?.flight_hours ?? NaN;
  const ends = life?.known && Number.isFinite(start)
    ? [life.hours_50, life.hours_05, life.hours_95].map((h) => (Number.isFinite(h) ? h : 0)) : [];
  const ahead = ends.length
    ? [...new Set([start, ...ends.map((end) => start + end)])].sort((a, b) => a - b) : [];
  const past = (values: Float64Array) =>
    [...order.map((i) => finite(values[i]!)), ...ahead.map(() => null)];
  const future = (end: number) => [
    ...order.map(() => null), ...ahead.map((x) => Math.max(end - (x - start), 0)),
  ];
  const medians = order.map((i) => columns.rul_50[i]!).filter(Number.isFinite);
  // The first predictions come from the prior and may be far above all later predictions.
  const high = [...medians].sort((a, b) => a - b)[Math.floor(0.9 * medians.length)] ?? 1;
  const top = 1.15 * Math.max(high, ...ends, 1);
  const data = [
    [...order.map((i) => columns.hours[i]!), ...ahead],
    past(columns.rul_50), past(columns.rul_05), past(columns.rul_95),
    ...(ends.length ? ends.map(future) : [0, 0, 0].map(() => order.map(() => null))),
  ] as uPlot.AlignedData;
  return { count: order.length, top, data };
}
