// SPDX-License-Identifier: Apache-2.0
// Plots of each fault over service hours: its tests, forecast and limit.

import { useMemo } from "preact/hooks";
import type uPlot from "uplot";
import { ASSESSED, FAULTS, type Fault, UNKNOWN_DRIVE, inPercent, isShown } from "../faults.ts";
import { fixed, hours as inHours, withSigma } from "../format.ts";
import { UNKNOWN } from "../levels.ts";
import type { HealthForecast } from "../messages.ts";
import type { Actuator } from "../state.ts";
import type { HistoryColumns } from "../unit_history.ts";
import { Badge, Empty, Section, itemLevel } from "./parts.tsx";
import { type Colour, Plot, intervals, line, upright } from "./plot.tsx";

const WIDTH_90 = 1.645; // standard deviations to either end of a 90 % interval

export function History({ actuator, columns }: { actuator: Actuator; columns?: HistoryColumns }) {
  const count = columns?.hours.length ?? 0;
  const note = columns && count > 0 && (
    <>
      {count} {count === 1 ? "test" : "tests"} with 90 % intervals
      {columns.omitted > 0 && <>, {columns.omitted} older tests not shown</>}; hollow: not
      significant; band: forecast, 5 – 95 %
    </>
  );
  const title = Number.isNaN(columns?.hours.at(-1)) ? "Faults over time" : "Faults over service hours";
  return (
    <Section title={title} id="history" note={note}>
      {!columns || count === 0 ? (
        <Empty>{columns ? "No test of this unit is stored yet." : "Loading the history…"}</Empty>
      ) : (
        <div class="plots many">
          {ASSESSED.filter(({ name }) => isShown(name, actuator.description)).map((fault) => (
            <Trend key={fault.name} fault={fault} columns={columns} actuator={actuator} />
          ))}
        </div>
      )}
    </Section>
  );
}

/** Plot of one fault: its tests, forecast and limit. */
export function Trend({ fault, columns, actuator, height = 210 }: {
  fault: Fault; columns: HistoryColumns; actuator: Actuator; height?: number;
}) {
  const { health } = actuator;
  const isHours = Number.isFinite(columns.hours.at(-1)!);
  const forecast = isHours ? actuator.forecast : undefined;
  const item = health?.faults.find(({ name }) => name === fault.name);
  const isDominant = health?.dominant_fault === fault.name;
  const k = FAULTS.indexOf(fault);
  const { scale, unit, decimals } = axisOf(fault, actuator);
  const built = useMemo(
    () => assemble(columns, k, isHours, forecast, fault.name, scale),
    [columns, forecast, isHours, k, scale],
  );
  const distance = scale * (item ? Math.abs(item.limit - fault.healthy) : 0.5);
  const healthy = scale * fault.healthy;
  const limits = fault.twoSided ? [healthy - distance, healthy + distance] : [healthy + distance];
  const bottom = fault.twoSided ? healthy - 1.2 * distance : 0;
  const top = healthy + 1.2 * distance;
  const now = isHours ? columns.hours.at(-1)! : columns.stamp.at(-1)!;
  const level = item ? itemLevel(actuator, item.level) : UNKNOWN;
  const normalised = item && unit === "-" ? ` · ${withSigma(item.value, item.sigma)}` : "";
  const shown = item ? inPercent(fault, item.value) + normalised : "–";

  const shownLimit = (limit: number) =>
    (unit === "-" ? fixed(limit, 2) : `+${fixed(limit, 0)} %`);
  const draw = (plot: uPlot, colour: Colour) => {
    intervals(plot, built.x, built.low, built.high, colour("interval"));
    for (const limit of limits) line(plot, limit, `limit ${shownLimit(limit)}`, colour("limit"));
    if (forecast) upright(plot, now, "now", colour("ink-soft"));
  };
  const series: uPlot.Series[] = [
    {
      label: "estimate", stroke: "data", width: 0,
      points: { show: true, size: 6, fill: "data", width: 1.5 },
      value: (_, v) => fixed(v, decimals),
    },
    {
      label: "not significant", stroke: "data", width: 0,
      points: { show: true, size: 6, fill: "card", width: 1.5 },
      value: (_, v) => fixed(v, decimals),
    },
    ...built.quantiles.map((p, i): uPlot.Series => ({
      label: `${100 * p} %`, stroke: "fan-line", width: i === built.middle ? 2 : 0.5,
      points: { show: false }, value: (_, v) => fixed(v, decimals),
    })),
  ];
  const last = 2 + built.quantiles.length;
  const bands = built.quantiles.length > 1 ? [{ series: [last, 3] as [number, number], fill: "fan" }]
    : [];
  return (
    <figure class={isDominant ? "dominant" : ""}>
      <figcaption>
        <strong>{fault.label}</strong> <span class="value">{shown}</span>
        {isDominant && <span class="tag">dominant</span>}
        <Badge level={level} />
      </figcaption>
      <Plot label={plotText(fault, shown, limits.map(shownLimit), columns, level.word, isHours)} height={height}
        x={isHours ? "service hours [h]" : "time of the test"} y={`${fault.label} [${unit}]`}
        isTime={!isHours} series={series} data={built.data} bands={bands} legend={false}
        yRange={(_, least, most) => [Math.min(bottom, least ?? 0), Math.max(top, 1.05 * (most ?? 0))]}
        draw={draw} />
    </figure>
  );
}

/** Scale and unit of a fault's axis; for a joint, friction is shown as a change in per cent. */
function axisOf(fault: Fault, { description }: Actuator) {
  const isPercent = description?.drive === UNKNOWN_DRIVE && fault.name === "friction";
  return isPercent ? { scale: (100 * fault.slope) / fault.base, unit: "%", decimals: 1 }
    : { scale: 1, unit: "-", decimals: 4 };
}

function plotText(
  fault: Fault, shown: string, limits: string[], columns: HistoryColumns, level: string,
  isHours: boolean,
): string {
  const until = isHours ? ` up to ${inHours(columns.hours.at(-1)!)} service hours` : "";
  return `${fault.label} over ${columns.hours.length} tests${until}: now ${shown}, limit ${limits.join(" and ")}, ` +
    `level ${level}`;
}

interface Assembled {
  x: number[];
  low: number[];
  high: number[];
  quantiles: number[];
  middle: number;
  data: uPlot.AlignedData;
}

/** Tests first, then the forecast, on one ascending axis. */
function assemble(
  columns: HistoryColumns, k: number, isHours: boolean, forecast: HealthForecast | undefined,
  name: string, scale: number,
): Assembled {
  const at = isHours ? columns.hours : columns.stamp;
  const order = Array.from(at.keys()).filter((i) => Number.isFinite(at[i]!))
    .sort((a, b) => at[a]! - at[b]!);
  const x = order.map((i) => at[i]!);
  const value = order.map((i) => scale * columns.faults[k]![i]!);
  const sigma = order.map((i) => scale * columns.sigmas[k]![i]!);
  const isHollow = order.map((i) => ((columns.insignificant[i]! >> k) & 1) === 1);
  const faultForecast = forecast?.faults.find((item) => item.name === name);
  const probabilities = faultForecast ? Array.from(forecast!.probabilities) : [];
  const ahead = faultForecast ? Array.from(forecast!.hours, (h) => forecast!.flight_hours + h) : [];
  const known = value.map((v) => (Number.isFinite(v) ? v : null));
  const gap = ahead.map(() => null);
  const data = [
    [...x, ...ahead],
    [...known.map((v, i) => (isHollow[i] ? null : v)), ...gap],
    [...known.map((v, i) => (isHollow[i] ? v : null)), ...gap],
    ...probabilities.map((_, row) => [
      ...x.map(() => null),
      ...Array.from(faultForecast!.values.subarray(row * ahead.length, (row + 1) * ahead.length),
        (value) => scale * value),
    ]),
  ] as uPlot.AlignedData;
  return {
    x,
    low: value.map((v, i) => v - WIDTH_90 * sigma[i]!),
    high: value.map((v, i) => v + WIDTH_90 * sigma[i]!),
    quantiles: probabilities,
    middle: probabilities.indexOf(0.5),
    data,
  };
}
