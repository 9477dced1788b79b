// One actuator: what is wrong, why, and how long it lasts.

import { labelOf } from "../faults.ts";
import { dateTime, duration, fixed, hours, percent } from "../format.ts";
import { seconds } from "../messages.ts";
import type { Address } from "../protocol.ts";
import { keyOf } from "../protocol.ts";
import type { Actuator, State } from "../state.ts";
import { AdviceCard } from "./advice.tsx";
import { Events } from "./events.tsx";
import { History } from "./history.tsx";
import { useApp, useSecond } from "./hooks.ts";
import { Life, RemoveBefore, why } from "./life.tsx";
import { Live } from "./live.tsx";
import { Badge, Bar, Empty, Figure, Since, classOf, levelOf, silence } from "./parts.tsx";
import { Remaining } from "./remaining.tsx";
import { Diagnostics } from "./system.tsx";
import { FaultVector, Requirements, TrackedFaults } from "./tables.tsx";
import { LastWindow } from "./window.tsx";

export function OneActuator({ state, address }: { state: State; address: Address }) {
  const key = keyOf(address);
  const actuator = state.actuators.get(key);
  const columns = state.history?.key === key ? state.history.columns : undefined;
  if (!actuator) {
    return (
      <main id="main" tabIndex={-1}>
        <nav class="back"><a href="#/">← Fleet</a></nav>
        <h1>{address.id}</h1>
        <Empty>
          {state.connection.state === "open" && state.topics
            ? `No message of this actuator has come in ${address.namespace || "/"}.`
            : "Connecting…"}
        </Empty>
      </main>
    );
  }
  const { health } = actuator;
  return (
    <main id="main" tabIndex={-1}>
      <nav class="back"><a href="#/">← Fleet</a></nav>
      <Head actuator={actuator} />
      <AdviceCard advice={actuator.advice} />
      <History actuator={actuator} columns={columns} />
      <Remaining health={health} columns={columns} />
      {health && <TrackedFaults actuator={actuator} health={health} />}
      {health && <Requirements actuator={actuator} health={health} />}
      <LastWindow actuator={actuator} />
      <FaultVector estimate={actuator.usable} />
      <Events events={columns?.events} now={state.now()} />
      <Live actuatorKey={key} />
      <Diagnostics state={state} of={address} />
    </main>
  );
}

function Head({ actuator }: { actuator: Actuator }) {
  const { health, estimate, description } = actuator;
  const level = levelOf(actuator);
  const worst = labelOf(health?.dominant_fault ?? "");
  const isRefused = estimate !== undefined && !estimate.valid;
  return (
    <section class={`card head ${classOf(level)}`} aria-labelledby="name">
      <div class="head-line">
        <div>
          <h1 id="name">{actuator.id}</h1>
          <p class="soft">
            {actuator.serial ? `serial number ${actuator.serial}` : "no serial number"}
            {description?.model && ` · ${description.model}`}
            {description && ` · ${fixed(1 / description.sample_period, 0)} samples a second`}
          </p>
        </div>
        <Badge level={level} large />
      </div>
      {isRefused && (
        <p class="banner error">
          <strong>The latest test was refused:</strong> {estimate.reason || "no reason given"}
        </p>
      )}
      {actuator.lost !== undefined && (
        <p class="banner warn">
          <strong>The monitor began anew:</strong> the {actuator.lost} tests that it knew before are
          not in its history. Trends and remaining life follow from {String(health?.cycles)}.
        </p>
      )}
      {health?.level === 3 && <Stale health={health} />}
      {health ? (
        <>
          <p class="why" role="status">
            {silence(actuator)}
            {health.cause.startsWith(`${worst} `) && <strong>{worst} </strong>}
            {why(health, worst)}
          </p>
          {health.removal && <p class="removal">{health.removal}</p>}
          <dl class="figures">
            <Figure label="remaining life" note={health.rul.known && health.rul.criterion}>
              <Life life={health.rul} />
            </Figure>
            <Figure label="remove before"><RemoveBefore health={health} /></Figure>
            <Figure label="health index" note={`severity ${health.severity} of 4`}>
              <span class="with-bar" data-figure="health_index">
                <Bar share={health.health_index} level={level} />
                {fixed(health.health_index, 2)}
              </span>
            </Figure>
            <Figure label="service" note={`${health.cycles} tests`}>
              {hours(health.flight_hours)} h
            </Figure>
            <Figure label="last test" note={dateTime(seconds(health.header.stamp))}>
              <Since health={health} suffix=" ago" />
            </Figure>
            <Figure label="confidence" note="observable faults, and fit">
              {percent(health.confidence)}
            </Figure>
          </dl>
        </>
      ) : <Empty>No health is known before the first valid test.</Empty>}
    </section>
  );
}

function Stale({ health }: { health: NonNullable<Actuator["health"]> }) {
  const { state } = useApp();
  useSecond();
  const since = state.now() - seconds(health.header.stamp);
  return (
    <p class="banner stale">
      <strong>Stale:</strong> the latest valid test was {duration(since)} ago.{" "}
      What is shown is as of then.
    </p>
  );
}
