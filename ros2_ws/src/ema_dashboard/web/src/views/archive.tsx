// SPDX-License-Identifier: Apache-2.0
// The fleet of an archive: results of all recorded units, including units that are not running.

import { useEffect, useMemo, useState } from "preact/hooks";
import uPlot from "uplot";
import { bagsText, curveOf, fetchSummary, type Levels, type Summary, type WorstUnit } from "../archive.ts";
import { labelOf } from "../faults.ts";
import { fixed, hours, lifeHours, percent, significant } from "../format.ts";
import { LEVELS, type Level, levelNow } from "../levels.ts";
import { Badge, Bar, Empty, Figure, Section, Shape } from "./parts.tsx";
import { Plot } from "./plot.tsx";

const AGAIN_MS = 60_000;
const MOST = 20;
const SHOWN_MONTHS = 12;
const ORDER = [LEVELS[2]!, LEVELS[1]!, LEVELS[3]!, LEVELS[0]!]; // the worst first

/** The summary of the archive; undefined until it is loaded, null without an archive. */
export function useSummary(isShown: boolean): { summary?: Summary | null; reason: string } {
  const [summary, set] = useState<Summary | null>();
  const [reason, setReason] = useState("");
  useEffect(() => {
    let isOver = false;
    const ask = () => fetchSummary(MOST).then(
      (loaded) => { if (!isOver) { set(loaded); setReason(""); } },
      (error: Error) => { if (!isOver) setReason(error.message); },
    );
    void ask();
    const timer = isShown ? setInterval(ask, AGAIN_MS) : undefined;
    return () => { isOver = true; clearInterval(timer); };
  }, [isShown]);
  return { summary, reason };
}

export function Archive({ summary, reason }: { summary?: Summary | null; reason: string }) {
  const unread = summary ? bagsText(summary) : "";
  return (
    <main id="main" tabIndex={-1} class="archive">
      <h1 class="view-title">
        Archive <span class="soft">{summary?.archive ?? ""}</span>
      </h1>
      {reason && (
        <p class="banner error" role="alert"><strong>Not loaded:</strong> {reason}</p>
      )}
      {unread && <p class="banner warn" role="status">{unread}</p>}
      {summary ? <Parts summary={summary} /> : !reason && (
        <Empty>
          {summary === undefined ? "Loading…"
            : "The dashboard shows no archive: set its parameter archive to the folder of an archive."}
        </Empty>
      )}
    </main>
  );
}

function Parts({ summary }: { summary: Summary }) {
  const { levels, models, ages, calibrations } = summary;
  if (!levels.units) return <Empty>No unit of the archive has a valid test yet.</Empty>;
  return (
    <>
      <section class="card" aria-label="Units by level">
        <dl class="figures">
          <Figure label="units" note={`latest test ${day(levels.latest_test)}`}>
            {whole(levels.units)}
          </Figure>
          {ORDER.map((level) => (
            <Figure key={level.name} label={level.word}
              note={percent(levels[level.name] / levels.units)}>
              <span class="with-bar" data-count={level.name}>
                <Shape level={level} size={20} /> {whole(levels[level.name])}
              </span>
            </Figure>
          ))}
        </dl>
      </section>
      <Worst units={summary.worst} all={levels.units} />
      <Survival summary={summary} />
      <div class="pair">
        <Section title="By model" id="models">
          <ByLevel heading="model" rows={models.map((model) => (
            { name: model.model, levels: model, more: [fixed(model.health_index ?? NaN, 2)] }
          ))} more={["health index"]} />
        </Section>
        <Section title="By age" id="ages" note="service hours">
          <ByLevel heading="service hours" rows={ages.map((group) => (
            { name: `${significant(group.from_hours, 4)} – ${significant(group.to_hours, 4)}`, levels: group,
              more: [fixed(group.health_index ?? NaN, 2)] }
          ))} more={["health index"]} />
        </Section>
        <Section title="Calibration age" id="calibrations"
          note="from the change of its file to the latest test">
          <Shares heading="age" rows={calibrations.map(({ age, units }) => (
            { name: age, count: units, total: levels.units }
          ))} unit="units" />
        </Section>
        <Coverage summary={summary} />
      </div>
    </>
  );
}

function Worst({ units, all }: { units: WorstUnit[]; all: number }) {
  return (
    <Section title="Worst units" id="worst" note={`${units.length} of ${whole(all)}`}>
      <div class="scroll" tabIndex={0} role="region" aria-label="Table of the worst units">
        <table class="items stacked">
          <thead>
            <tr>
              <th scope="col">unit</th>
              <th scope="col">level</th>
              <th scope="col">health index</th>
              <th scope="col">worst fault or requirement</th>
              <th scope="col" class="number">remaining life <small>median, 5 – 95 %</small></th>
              <th scope="col" class="number">remove before <small>service hour</small></th>
              <th scope="col" class="number">service</th>
              <th scope="col" class="number">last test</th>
            </tr>
          </thead>
          <tbody>
            {units.map((unit) => {
              const [now, last] = [unit.health, unit.last_health].map((name) =>
                LEVELS.findIndex(({ word }) => word === name));
              const level = levelNow(now!, last!);
              return (
                <tr key={`${unit.model}/${unit.actuator_id}/${unit.serial_number}`}
                  data-unit={`${unit.actuator_id}/${unit.serial_number}`}>
                  <th scope="row">
                    {unit.actuator_id} <small>{unit.serial_number} · {unit.model}</small>
                  </th>
                  <td data-label="level"><Badge level={level} /></td>
                  <td data-label="health index"><Health index={unit.health_index} level={level} /></td>
                  <td data-label="worst">{unit.dominant_fault ? labelOf(unit.dominant_fault) : "–"}</td>
                  <td class="number" data-label="remaining life"><Left unit={unit} /></td>
                  <td class="number" data-label="remove before service hour">{removal(unit)}</td>
                  <td class="number" data-label="service">{hours(unit.flight_hours ?? NaN)} h</td>
                  <td class="number" data-label="last test">{day(unit.tested)}</td>
                </tr>
              );
            })}
          </tbody>
        </table>
      </div>
    </Section>
  );
}

function Health({ index, level }: { index: number | null; level: Level }) {
  if (index === null) return <>–</>;
  return (
    <span class="with-bar">
      <Bar share={index} level={level} /> <strong>{fixed(index, 2)}</strong>
    </span>
  );
}

function Left({ unit }: { unit: WorstUnit }) {
  if (lastKnown(unit) === "ERROR") return <strong>none left</strong>;
  if (!unit.rul.known) return <span class="soft">unknown</span>;
  const { hours_05, hours_50, hours_95 } = unit.rul;
  const [low, median, high] = [hours_05, hours_50, hours_95].map((h) => h ?? Infinity);
  const life = { hours_05: low!, hours_50: median!, hours_95: high! };
  if (median === Infinity) return <>more than {lifeHours(low!, life)} h</>;
  return (
    <>
      <strong>{lifeHours(median!, life)} h</strong>{" "}
      <small>{lifeHours(low!, life)} – {lifeHours(high!, life)} h</small>
    </>
  );
}

/** The latest known level. */
function lastKnown({ health, last_health }: WorstUnit): string | null {
  return health === "STALE" ? last_health : health;
}

function removal(unit: WorstUnit): string {
  if (lastKnown(unit) === "ERROR") return "now";
  if (unit.removal_hours === null || unit.flight_hours === null) return "–";
  return `${hours(unit.flight_hours + unit.removal_hours)} h`;
}

function Survival({ summary }: { summary: Summary }) {
  const { survival, lives, failures } = summary;
  const data = useMemo(() => curveOf(summary) as uPlot.AlignedData, [summary]);
  const steps = uPlot.paths.stepped!({ align: 1 });
  const shared = { paths: steps, points: { show: false },
    value: (_: uPlot, share: number) => percent(share) };
  const last = survival.at(-1);
  const words = last
    ? `${whole(failures)} of ${whole(lives)} lives have ended. ${percent(last.share)} survive ` +
      `${hours(last.age)} service hours.`
    : `None of ${whole(lives)} lives has ended.`;
  return (
    <Section title="Survival" id="survival" note={words}>
      {data[0].length > 1 ? (
        <Plot label={words} height={260} x="service hours since new or repaired [h]"
          y="share without failure" data={data} legend={false} yRange={() => [0, 1.02]}
          series={[
            { label: "share", stroke: "data", width: 2.5, ...shared },
            { label: "5 %", stroke: "data", width: 0.7, ...shared },
            { label: "95 %", stroke: "data", width: 0.7, ...shared },
          ]} bands={[{ series: [3, 2], fill: "band" }]} />
      ) : <Empty>No unit has recorded service hours.</Empty>}
    </Section>
  );
}

function ByLevel({ heading, rows, more }: {
  heading: string; more: string[];
  rows: { name: string; levels: Levels; more: string[] }[];
}) {
  const most = Math.max(...rows.map(({ levels }) => levels.units), 1);
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={`Table by ${heading}`}>
      <table class="items">
        <thead>
          <tr>
            <th scope="col">{heading}</th>
            <th scope="col"><span class="unseen">units as a bar</span></th>
            <th scope="col" class="number">units</th>
            {ORDER.map(({ name, word }) => <th key={name} scope="col" class="number">{word}</th>)}
            {more.map((name) => <th key={name} scope="col" class="number">{name}</th>)}
          </tr>
        </thead>
        <tbody>
          {rows.map(({ name, levels, more }) => (
            <tr key={name}>
              <th scope="row">{name}</th>
              <td>
                <span class="stack" aria-hidden="true">
                  {ORDER.map((level) => (
                    <span key={level.name} class={level.name}
                      style={{ width: `${100 * levels[level.name] / most}%` }} />
                  ))}
                </span>
              </td>
              <td class="number">{whole(levels.units)}</td>
              {ORDER.map((level) => (
                <td key={level.name} class="number">{levels[level.name] ? whole(levels[level.name]) : "–"}</td>
              ))}
              {more.map((value, k) => <td key={k} class="number">{value}</td>)}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

function Shares({ heading, rows, unit }: {
  heading: string; unit: string; rows: { name: string; count: number; total: number }[];
}) {
  return (
    <table class="items">
      <thead>
        <tr>
          <th scope="col">{heading}</th>
          <th scope="col"><span class="unseen">share as a bar</span></th>
          <th scope="col" class="number">{unit}</th>
          <th scope="col" class="number">share</th>
        </tr>
      </thead>
      <tbody>
        {rows.map(({ name, count, total }) => (
          <tr key={name}>
            <th scope="row">{name}</th>
            <td>
              <span class="stack" aria-hidden="true">
                <span class="share" style={{ width: `${100 * count / Math.max(total, 1)}%` }} />
              </span>
            </td>
            <td class="number">{whole(count)}</td>
            <td class="number">{percent(count / total)}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

function Coverage({ summary }: { summary: Summary }) {
  const { recent, months } = summary;
  const shown = months.slice(-SHOWN_MONTHS);
  const [windows, valid] = [shown, shown].map((rows, k) =>
    rows.reduce((sum, row) => sum + (k ? row.valid : row.windows), 0));
  return (
    <Section title="Test coverage" id="coverage"
      note={`${percent(valid! / windows!)} of the windows below have a valid estimate`}>
      <Shares heading="units tested" unit="units" rows={recent.map((period) => (
        { name: period.days === 1 ? "in the last day" : `in the last ${period.days} days`,
          count: period.tested, total: period.units }
      ))} />
      <h3>Units tested per month</h3>
      <Shares heading="month" unit="units" rows={shown.map((month) => (
        { name: month.month, count: month.tested, total: month.units }
      ))} />
    </Section>
  );
}

function whole(count: number): string {
  return count.toLocaleString("en-GB");
}

function day(time: string | null): string {
  return time?.slice(0, 10) ?? "–";
}
