// SPDX-License-Identifier: Apache-2.0
// The latest window: measured and estimated signals, and quality of the estimate.

import { useMemo } from "preact/hooks";
import type uPlot from "uplot";
import { labelOf } from "../faults.ts";
import { dateTime, fixed, percent, significant, unit, withSigma } from "../format.ts";
import { type Confusion, type FaultEstimate, type HiddenCause, VERDICTS, type WindowFit, seconds } from "../messages.ts";
import { isOfRecord } from "../quantities.ts";
import type { Actuator } from "../state.ts";
import { Empty, Figure, Section } from "./parts.tsx";
import { Plot } from "./plot.tsx";

export function LastWindow({ actuator }: { actuator: Actuator }) {
  const { estimate, fit } = actuator;
  if (!estimate && !fit) {
    return (
      <Section title="Last test" id="window"><Empty>No window has been found yet.</Empty></Section>
    );
  }
  return (
    <Section title="Last test" id="window"
      note={estimate && `${isOfRecord(estimate) ? "record" : "window"} ${estimate.window}, ended ` +
        dateTime(seconds(estimate.window_end))}>
      {estimate && <Trust estimate={estimate} />}
      <Shown estimate={estimate} fit={fit} />
    </Section>
  );
}

/** The signals of the window, or the reason why there are none. */
function Shown({ estimate, fit }: { estimate?: FaultEstimate; fit?: WindowFit }) {
  if (estimate?.stretches) {
    return (
      <Empty>
        This estimate combines {estimate.stretches}{" "}
        {estimate.stretches === 1 ? "stretch" : "stretches"} of ordinary motion. The monitor does not
        store their telemetry, so there are no signals to show.
      </Empty>
    );
  }
  if (fit && fit.position.length > 0) return <Signals fit={fit} />;
  if (estimate && isOfRecord(estimate)) {
    return <Empty>Monitors do not publish the signals of records. Telemetry shows the live signals.</Empty>;
  }
  return <Empty>No signals of this window have been received.</Empty>;
}

const MARKS = ["ok", "warn", "error", "error", "error", "warn"] as const;

function Trust({ estimate }: { estimate: FaultEstimate }) {
  const verdict = VERDICTS[estimate.verdict] ?? "refused";
  const isRecord = isOfRecord(estimate);
  const isGood = estimate.goodness_of_fit <= estimate.goodness_limit;
  return (
    <>
      <p class={`verdict ${MARKS[estimate.verdict] ?? "error"}`}>
        <strong>{verdict}</strong>
        {estimate.reason && <>: {estimate.reason}</>}
      </p>
      <dl class="figures small">
        {!isRecord && (
          <>
            <Figure label="goodness of fit"
              note={`limit ${significant(estimate.goodness_limit, 3)}${isGood ? "" : ", exceeded"}`}>
              {significant(estimate.goodness_of_fit, 3)}
            </Figure>
            <Figure label="unexplained share">{percent(estimate.unexplained_share)}</Figure>
            <Figure label="travel of the command"
              note={`at least ${significant(estimate.excitation_limit, 2)} rad`}>
              {significant(estimate.excitation, 3)} rad
            </Figure>
          </>
        )}
        <Figure label="calibration"
          note={`${estimate.calibration_windows} healthy ${isRecord ? "records" : "windows"}`}>
          {estimate.calibration_id || "none"}
        </Figure>
        {!isRecord && (
          <Figure label="search" note={estimate.warm_start ? "warm start" : "cold start"}>
            {String(estimate.evaluations)} evaluations
          </Figure>
        )}
      </dl>
      <Causes title="Explained by causes other than faults" causes={estimate.causes} />
      <Causes title="Measured, and assumed known" causes={estimate.measured} />
      {estimate.alternatives.length > 0 && (
        <p class="remark">This {isRecord ? "record" : "window"} cannot separate: {estimate.alternatives.map(confused).join("; ")}.</p>
      )}
    </>
  );
}

/** A pair of explanations as text. */
function confused({ part, stand_in }: Confusion): string {
  return [part, stand_in].map((names) => names.map(labelOf).join(" and ")).join(" or ");
}

function Causes({ title, causes }: { title: string; causes: HiddenCause[] }) {
  if (causes.length === 0) return null;
  return (
    <div class="causes">
      <h3>{title}</h3>
      <ul>
        {causes.map((cause) => (
          <li key={cause.name}>
            <strong>{labelOf(cause.name)}</strong> {withSigma(cause.value, cause.sigma)}
            {cause.unit === "-" ? " (relative change)" : unit(cause.unit)}
          </li>
        ))}
      </ul>
    </div>
  );
}

function Signals({ fit }: { fit: WindowFit }) {
  const built = useMemo(() => {
    const time = Array.from(fit.position, (_, i) => fit.start + i * fit.period);
    // The column of a quantity that is not measured is empty and has no residual.
    const shown = (values: Float32Array) => (values.length ? values : time.map(() => null));
    const difference = (measured: Float32Array, model: Float32Array) =>
      time.map((_, i) => (measured.length === model.length ? measured[i]! - model[i]! : null));
    const rms = (values: (number | null)[]) =>
      Math.sqrt(values.reduce<number>((sum, v) => sum + (v ?? NaN) ** 2, 0) / values.length);
    const current = difference(fit.current, fit.estimated_current);
    const speed = difference(fit.speed, fit.estimated_speed);
    return {
      current: [time, shown(fit.current), shown(fit.estimated_current)],
      currentRest: [time, current],
      speed: [time, shown(fit.speed), shown(fit.estimated_speed)],
      speedRest: [time, speed],
      angle: [time, fit.command, fit.position],
      rms: { current: rms(current), speed: rms(speed) },
      measured: { current: fit.current.length > 0, speed: fit.speed.length > 0 },
    } as unknown as Record<string, uPlot.AlignedData> &
      { rms: { current: number; speed: number }; measured: { current: boolean; speed: boolean } };
  }, [fit]);
  const note = (isMeasured: boolean) => !isMeasured && <span class="value">not measured</span>;
  const series = (digits: number, names: [string, string]): uPlot.Series[] => [
    { label: names[0], stroke: "data", width: 1.8, points: { show: false }, value: figure(digits) },
    {
      label: names[1], stroke: "model", width: 2, dash: [7, 4], points: { show: false },
      value: figure(digits),
    },
  ];
  const residual = (digits: number): uPlot.Series[] => [
    {
      label: "measured − model", stroke: "rest", width: 1.4, points: { show: false },
      value: figure(digits),
    },
  ];
  const pair: [string, string] = ["measured", "model"];
  const x = "time in the window [s]";
  const shared = { x, sync: "window" };
  return (
    <div class="plots">
      <figure>
        <figcaption><strong>current</strong> {note(built.measured.current)}</figcaption>
        <Plot {...shared} label="Measured current against the model" height={210}
          y="current [A]" series={series(3, pair)} data={built.current!} />
      </figure>
      <figure>
        <figcaption>
          <strong>residual of the current</strong>
          <span class="value">rms {significant(built.rms.current, 3)} A</span>
        </figcaption>
        <Plot {...shared} label={`Residual of the current, rms ${significant(built.rms.current, 3)} A`}
          height={210} y="residual [A]" series={residual(3)} data={built.currentRest!} />
      </figure>
      <figure>
        <figcaption><strong>speed</strong> {note(built.measured.speed)}</figcaption>
        <Plot {...shared} label="Measured motor speed against the model" height={210}
          y="speed [rad/s]" series={series(1, pair)} data={built.speed!} />
      </figure>
      <figure>
        <figcaption>
          <strong>residual of the speed</strong>
          <span class="value">rms {significant(built.rms.speed, 3)} rad/s</span>
        </figcaption>
        <Plot {...shared}
          label={`Residual of the speed, rms ${significant(built.rms.speed, 3)} rad/s`}
          height={210} y="residual [rad/s]" series={residual(2)} data={built.speedRest!} />
      </figure>
      <figure>
        <figcaption><strong>command and position</strong></figcaption>
        <Plot {...shared} label="Commanded and measured angle of the user shaft" height={210}
          y="angle [rad]" series={series(5, ["command", "position"])} data={built.angle!} />
      </figure>
    </div>
  );
}

function figure(digits: number) {
  return (_: uPlot, value: number | null) => (value === null ? "" : fixed(value, digits));
}
