// SPDX-License-Identifier: Apache-2.0
// Tables of requirements and faults, and the fault vector with its covariance.

import { useState } from "preact/hooks";
import { FAULTS, faultOf, inPercent, isShown, labelOf, physical } from "../faults.ts";
import { fixed, shownUnit, significant, unit, withSigma } from "../format.ts";
import type { ActuatorDescription, FaultEstimate, FaultHealth, Health } from "../messages.ts";
import { isOfRecord } from "../quantities.ts";
import type { Actuator } from "../state.ts";
import { Life } from "./life.tsx";
import { Badge, Empty, Section, itemLevel } from "./parts.tsx";

const PER_HOURS = 1000;
const NEGLIGIBLE = 0.01; // share of sigma
const WIDENED = 1.05;

interface OfHealth {
  actuator: Actuator;
  health: Health;
}

export function Requirements({ actuator, health }: OfHealth) {
  const items = health.requirements;
  return (
    <Section title="Required performance" id="requirements">
      {items.length === 0 ? (
        <Empty>No requirement has been assessed yet{health.reason && `: ${health.reason}`}.</Empty>
      ) : <Items actuator={actuator} items={items} heading="requirement" />}
    </Section>
  );
}

export function TrackedFaults({ actuator, health }: OfHealth) {
  return (
    <Section title="Faults after all tests" id="tracked">
      <Items actuator={actuator} heading="fault"
        items={health.faults.filter(({ name }) => isShown(name, actuator.description))} />
    </Section>
  );
}

function Items(
  { actuator, items, heading }: { actuator: Actuator; items: FaultHealth[]; heading: string },
) {
  const isOfFaults = heading === "fault";
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={`Table of each ${heading}`}>
      <table class="items stacked">
        <thead>
          <tr>
            <th scope="col">{heading}</th>
            <th scope="col">level</th>
            {isOfFaults && <th scope="col" class="number">change</th>}
            <th scope="col" class="number">value ± σ</th>
            <th scope="col" class="number">limit</th>
            <th scope="col" class="number">growth <small>in {PER_HOURS} h</small></th>
            <th scope="col" class="number">remaining life <small>5 – 95 %</small></th>
          </tr>
        </thead>
        <tbody>
          {items.map((item) => {
            const [name, scale] = shownUnit(item.unit);
            const digits = item.limit === 0 ? 3 : Math.max(3, significantOf(item.limit * scale));
            return (
              <tr key={item.name} data-item={item.name}>
                <th scope="row">{labelOf(item.name)}</th>
                <td data-label="level"><Badge level={itemLevel(actuator, item.level)} /></td>
                {isOfFaults && (
                  <td class="number" data-label="change">
                    <strong>{inPercent(faultOf(item.name)!, item.value)}</strong>
                  </td>
                )}
                <td class="number" data-label="value ± σ" data-value={item.value}>
                  {withSigma(scale * item.value, scale * item.sigma)}{unit(name)}
                </td>
                <td class="number" data-label="limit">
                  {item.limit_is_lower ? "≥ " : "≤ "}
                  {significant(scale * item.limit, digits)}{unit(name)}
                </td>
                <td class="number" data-label={`growth in ${PER_HOURS} h`}>
                  {growth(scale * PER_HOURS * item.trend, scale * item.sigma, unit(name))}
                </td>
                <td class="number" data-label="remaining life"><Life life={item.rul} /><Widening item={item} /></td>
              </tr>
            );
          })}
        </tbody>
      </table>
    </div>
  );
}

/** Note that an interval was widened because earlier predictions were too narrow. */
function Widening({ item }: { item: FaultHealth }) {
  // Old recordings have no widening; NaN is unknown.
  if (!item.rul.known || !(item.widening > WIDENED)) return null;
  const checked = `The root mean square of the normal scores of past predictions is ` +
    `${fixed(item.score_rms, 2)} for the next test and ${fixed(item.score_rms_ahead, 2)} ` +
    "for twenty tests ahead; above 1, their intervals were too narrow.";
  return <small class="soft nowrap" title={checked}> widened × {fixed(item.widening, 1)}</small>;
}

function significantOf(value: number): number {
  return Math.min(String(Number(Math.abs(value).toPrecision(4))).replace(/^0\.0*|\./g, "").length, 4);
}

function growth(value: number, sigma: number, unitText: string): string {
  if (!Number.isFinite(value)) return "–";
  if (Math.abs(value) < NEGLIGIBLE * sigma) return "0";
  return (value > 0 ? "+" : "") + significant(value, 2) + unitText;
}

export function FaultVector({ estimate, description }: {
  estimate?: FaultEstimate; description?: ActuatorDescription;
}) {
  const [shows, setShows] = useState<"correlation" | "covariance">("correlation");
  if (!estimate) {
    return (
      <Section title="Fault vector of the latest usable test" id="vector">
        <Empty>No test has given an estimate yet.</Empty>
      </Section>
    );
  }
  const n = FAULTS.length;
  const sigma = FAULTS.map((_, k) => Math.sqrt(estimate.covariance[k * n + k]!));
  const shown = FAULTS.map((fault, k) => [fault, k] as const)
    .filter(([{ name }]) => isShown(name, description));
  return (
    <Section title="Fault vector of the latest usable test" id="vector"
      note={`${isOfRecord(estimate) ? "record" : "window"} ${estimate.window}, identified by ` +
        `${labelOf(estimate.algorithm)} in ${fixed(estimate.computing_time, 2)} s`}>
      <div class="vector">
        <div class="scroll" tabIndex={0} role="region" aria-label="Table of the fault vector">
          <table class="items">
            <thead>
              <tr>
                <th scope="col">fault</th>
                <th scope="col" class="number">k ± σ <small>[-]</small></th>
                <th scope="col">which means</th>
              </tr>
            </thead>
            <tbody>
              {shown.map(([fault, k]) => {
                const value = estimate.faults[fault.name]!;
                const isHidden = (estimate.unobservable >> k) & 1;
                const isHealthy = (estimate.insignificant >> k) & 1;
                return (
                  <tr key={fault.name} data-fault={fault.name}>
                    <th scope="row">{fault.label}</th>
                    <td class="number" data-value={value}>
                      {isHidden ? "–" : withSigma(value, sigma[k]!)}
                    </td>
                    <td>
                      {isHidden ? `not observable in this ${isOfRecord(estimate) ? "record" : "window"}`
                        : isHealthy ? "healthy (not significant)"
                          : physical(faultOf(fault.name)!, value, sigma[k]!, description)}
                    </td>
                  </tr>
                );
              })}
            </tbody>
          </table>
        </div>
        {/* A record has no covariance between faults. */}
        {!isOfRecord(estimate) && (
          <div>
            <div class="choice" role="group" aria-label="Matrix">
              {(["correlation", "covariance"] as const).map((kind) => (
                <button type="button" key={kind} aria-pressed={shows === kind}
                  onClick={() => setShows(kind)}>{kind}</button>
              ))}
            </div>
            <Matrix covariance={estimate.covariance} sigma={sigma} shows={shows} />
          </div>
        )}
      </div>
    </Section>
  );
}

const SHORT: Record<string, string> = {
  friction: "fric", backlash: "backl", short_circuit_a: "sc A", short_circuit_b: "sc B",
  short_circuit_c: "sc C", eccentricity: "ecc", eccentricity_phase: "phase", gain: "gain",
};

function Matrix({ covariance, sigma, shows }: {
  covariance: Float64Array; sigma: number[]; shows: "correlation" | "covariance";
}) {
  const n = FAULTS.length;
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={`Table of the ${shows}`}>
      <table class={`matrix ${shows}`}>
        <caption class="unseen">{shows} of the fault vector [-]</caption>
        <thead>
          <tr>
            <td />
            {FAULTS.map(({ name, label }) => (
              <th key={name} scope="col"><abbr title={label}>{SHORT[name] ?? name}</abbr></th>
            ))}
          </tr>
        </thead>
        <tbody>
          {FAULTS.map(({ name, label }, row) => (
            <tr key={name}>
              <th scope="row"><abbr title={label}>{SHORT[name] ?? name}</abbr></th>
              {FAULTS.map((other, column) => {
                const value = covariance[row * n + column]!;
                const share = value / (sigma[row]! * sigma[column]!);
                const text = shows === "correlation" ? fixed(share, 2)
                  : Number.isFinite(value) ? scientific(value) : "–";
                return (
                  <td key={other.name} class={share < 0 ? "negative" : "positive"}
                    style={{ "--share": Number.isFinite(share) ? Math.abs(share) : 0 }}>
                    {text}
                  </td>
                );
              })}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

function scientific(value: number): string {
  return value === 0 ? "0" : value.toExponential(1).replaceAll("-", "−");
}
