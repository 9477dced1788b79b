// SPDX-License-Identifier: Apache-2.0
// Page of one actuator: level, cause and remaining life, then one of its parts.

import type { ComponentChildren } from "preact";
import { ASSESSED, type Fault, faultOf, inPercent, labelOf } from "../faults.ts";
import { dateTime, duration, fixed, hours, percent, shownUnit, significant, unit } from "../format.ts";
import { DEPARTED, ERROR, type FaultHealth, type Health, OK, STALE, seconds } from "../messages.ts";
import { keyOf } from "../protocol.ts";
import type { Actuator, State } from "../state.ts";
import { type HistoryColumns, newHistoryNotice } from "../unit_history.ts";
import { Folded, WhatToDo, isPhone } from "./advice.tsx";
import { Baseline, Progress } from "./baseline.tsx";
import { Events } from "./events.tsx";
import { FrictionOverSpeed } from "./friction.tsx";
import { History, Trend } from "./history.tsx";
import { useApp, useSecond } from "./hooks.ts";
import { isJoint, isLearning } from "../joints.ts";
import { Life, RemoveBefore, why } from "./life.tsx";
import { Live } from "./live.tsx";
import {
  Badge, Bar, Empty, Figure, Shape, Since, classOf, itemLevel, levelOf, silence,
} from "./parts.tsx";
import { Quantities } from "./quantities.tsx";
import { Remaining } from "./remaining.tsx";
import { PARTS, type Part, type Place, addressOf } from "./route.ts";
import { Diagnostics } from "./system.tsx";
import { FaultVector, Requirements, TrackedFaults } from "./tables.tsx";
import { LastWindow } from "./window.tsx";

export function OneActuator({ state, address }: { state: State; address: Place }) {
  const key = keyOf(address);
  const actuator = state.actuators.get(key);
  const columns = state.history?.key === key ? state.history.columns : undefined;
  if (!actuator) {
    return (
      <main id="main" tabIndex={-1}>
        <nav class="back"><a href="#/">← Overview</a></nav>
        <h1>{address.id}</h1>
        <Empty>
          {state.connection.state === "open" && state.topics
            ? `No message from this actuator has been received in ${address.namespace || "/"}.`
            : "Connecting…"}
        </Empty>
      </main>
    );
  }
  return (
    <main id="main" tabIndex={-1}>
      <Head actuator={actuator} columns={columns} />
      <nav class="parts" aria-label="Parts">
        {Object.entries(PARTS).map(([part, title]) => (
          <a key={part} href={`${addressOf(address)}/${part}`}
            aria-current={part === address.part ? "page" : undefined}>{title}</a>
        ))}
      </nav>
      {contents(state, address, actuator, columns)[address.part]()}
    </main>
  );
}

function contents(
  state: State, address: Place, actuator: Actuator, columns?: HistoryColumns,
): Record<Part, () => ComponentChildren> {
  const { health, description } = actuator;
  const baseline = actuator.baseline && (
    <Baseline baseline={actuator.baseline} description={description} address={address} />
  );
  return {
    faults: () => isLearning(actuator) ? baseline : (
      <>
        <FrictionOverSpeed curve={actuator.curve} description={description} />
        <Quantities estimate={actuator.estimate} />
        <History actuator={actuator} columns={columns} />
        {health && <TrackedFaults actuator={actuator} health={health} />}
        {baseline}
      </>
    ),
    life: () => (
      <>
        <Remaining health={health} columns={columns} />
        {health && <Requirements actuator={actuator} health={health} />}
      </>
    ),
    test: () => <LastWindow actuator={actuator} />,
    evidence: () => <FaultVector estimate={actuator.usable} description={actuator.description} />,
    telemetry: () => (
      <>
        <Live actuatorKey={actuator.key} description={actuator.description} />
        <Diagnostics state={state} address={address} />
      </>
    ),
    events: () => <Events events={columns?.events} now={state.now()} address={address} />,
  };
}

function Head({ actuator, columns }: { actuator: Actuator; columns?: HistoryColumns }) {
  const { health, estimate, description } = actuator;
  const level = levelOf(actuator);
  const fault = health && worstFault(health);
  const notice = columns && newHistoryNotice(columns);
  const isDeparted = estimate?.verdict === DEPARTED;
  const learning = isLearning(actuator) ? actuator.baseline : undefined;
  // Records of a learning joint give no estimate; any other reason is a defect of the record.
  const isOfLearning = estimate?.reason_codes?.length === 1 &&
    estimate.reason_codes[0] === "learning";
  const isRefused = estimate !== undefined && (!estimate.valid || isDeparted) && !isOfLearning;
  return (
    <section class={`card head ${classOf(level)}`} aria-labelledby="name">
      <div class="head-line">
        <div>
          <nav class="back"><a href="#/">← Overview</a></nav>
          <h1 id="name">{actuator.id}</h1>
          <p class="soft">
            {actuator.serial ? `serial number ${actuator.serial}` : "no serial number"}
            {description?.model && ` · ${description.model}`}
            {description && ` · ${fixed(1 / description.sample_period, 0)} samples per second`}
          </p>
        </div>
        <Badge level={level} large />
      </div>
      {isRefused && (
        <p class={`banner ${isDeparted ? "warn" : "error"}`}>
          <strong>
            {isJoint(actuator) ? "The latest record" : "The latest test"}{" "}
            {isDeparted ? `differs from healthy ${isJoint(actuator) ? "records" : "tests"}` : "was refused"}:
          </strong>{" "}
          <Folded title="Why">{estimate.reason || "no reason given"}</Folded>
        </p>
      )}
      {notice && (
        <p class="banner warn">
          <strong>Tests are lost:</strong> {notice}. Trends and remaining life are based on the tests
          since then.
        </p>
      )}
      {health?.level === 3 && !learning && <Stale health={health} />}
      {learning && <Progress baseline={learning} />}
      {learning && level.name === "learning" ? null : health ? (
        <div class="summary">
          <div>
            <Wrong actuator={actuator} health={health} />
            <WhatToDo advice={actuator.advice} health={health}
              isDeparted={isDeparted && health.level !== ERROR} />
          </div>
          {fault && columns && columns.hours.length > 0 && (
            <Trend fault={fault} columns={columns} actuator={actuator}
              height={isPhone() ? 160 : 190} />
          )}
          <dl class="figures">
            <Figure label="remaining life" note={health.rul.known && health.rul.criterion}>
              <Life life={health.rul} />
            </Figure>
            <Figure label="remove"><RemoveBefore health={health} /></Figure>
            <Figure label="health index" note={`severity ${health.severity} of 4`}>
              <span class="with-bar" data-figure="health_index">
                {Number.isFinite(health.health_index) && (
                  <Bar share={health.health_index} level={level} />
                )}
                {fixed(health.health_index, 2)}
              </span>
            </Figure>
            <Figure label="service" note={`${health.cycles} tests`}>
              {hours(health.flight_hours)} h
            </Figure>
            <Figure label="last test" note={dateTime(seconds(health.header.stamp))}>
              <Since health={health} suffix=" ago" />
            </Figure>
            <Figure label="confidence" note="observable faults and fit">
              {percent(health.confidence)}
            </Figure>
          </dl>
        </div>
      ) : <Empty>The health is unknown until the first valid test.</Empty>}
    </section>
  );
}

/** Faults and requirements that cause the level, with value and limit. */
function Wrong({ actuator, health }: { actuator: Actuator; health: Health }) {
  const items = [...health.faults, ...health.requirements]
    .filter(({ level }) => level !== OK && level !== STALE)
    .sort((a, b) => b.level - a.level ||
      Number(b.name === health.dominant_fault) - Number(a.name === health.dominant_fault));
  return (
    <div class="wrong">
      <h2>What is wrong</h2>
      <ul>
        {items.map((item) => {
          const [value, limit] = valueAndLimit(item);
          return (
            <li key={item.name} data-wrong={item.name}>
              <Shape level={itemLevel(actuator, item.level)} size={20} />
              <strong>{labelOf(item.name)} {value}</strong> <span class="soft">fails at {limit}</span>
            </li>
          );
        })}
      </ul>
      <p class="why" role="status">{silence(actuator)}{why(health)}</p>
    </div>
  );
}

function valueAndLimit(item: FaultHealth): [string, string] {
  const fault = faultOf(item.name);
  if (!fault) {
    const [name, scale] = shownUnit(item.unit);
    return [item.value, item.limit]
      .map((value) => significant(scale * value, 3) + unit(name)) as [string, string];
  }
  const isBelow = fault.twoSided && item.value < fault.healthy;
  const limit = isBelow ? 2 * fault.healthy - item.limit : item.limit;
  return [inPercent(fault, item.value), inPercent(fault, limit)];
}

/** The fault whose trend is shown: the dominant fault, else the fault nearest to its limit. */
function worstFault(health: Health): Fault | undefined {
  const share = ({ name }: Fault) => {
    const item = health.faults.find((tracked) => tracked.name === name);
    const healthy = faultOf(name)!.healthy;
    return item ? Math.abs((item.value - healthy) / (item.limit - healthy)) || 0 : -1;
  };
  return ASSESSED.find(({ name }) => name === health.dominant_fault) ??
    [...ASSESSED].sort((a, b) => share(b) - share(a))[0];
}

function Stale({ health }: { health: NonNullable<Actuator["health"]> }) {
  const { state } = useApp();
  useSecond();
  const since = state.now() - seconds(health.header.stamp);
  return (
    <p class="banner stale">
      <strong>Stale:</strong> the latest valid test was {duration(since)} ago.{" "}
      The values shown are from that time.
    </p>
  );
}
