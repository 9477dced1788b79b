// SPDX-License-Identifier: Apache-2.0
// Live telemetry of one actuator, drawn at most 20 times per second, and only while visible.

import { useEffect, useRef, useState } from "preact/hooks";
import uPlot from "uplot";
import type { ActuatorDescription } from "../messages.ts";
import { effortOf } from "../faults.ts";
import { significant } from "../format.ts";
import type { LiveSignals } from "../telemetry.ts";
import { SHOWN_S } from "../telemetry.ts";
import { useApp } from "./hooks.ts";
import { Empty, Section } from "./parts.tsx";
import { Plot } from "./plot.tsx";

const EMPTY: uPlot.AlignedData = [[], []];
const X = "time before the latest sample [s]";
const xRange = (): [number, number] => [-SHOWN_S, 0];

/** Scaled values, with null for slots without samples, which uPlot draws as gaps. */
function withGaps(values: Float64Array, scale: number): (number | null)[] {
  return Array.from(values, (value) => (Number.isNaN(value) ? null : scale * value));
}

interface Drawn {
  plot: uPlot;
  isSeen: () => boolean;
  columns: (keyof LiveSignals["values"])[];
}

export function Live({ actuatorKey, description }: {
  actuatorKey: string; description?: ActuatorDescription;
}) {
  const { state } = useApp();
  const [isPaused, setPaused] = useState(false);
  const [period, setPeriod] = useState<number | undefined>();
  const [isSilent, setSilent] = useState(false);
  const plots = useRef(new Map<string, Drawn>());
  const paused = useRef(false);
  paused.current = isPaused;
  const lead = description?.lead ?? 0;
  const travelPerAngle = lead > 0 ? (1e3 * lead) / (2 * Math.PI) : 1;
  const effort = effortOf(description);
  const scale = useRef({ position: 1, command: 1, speed: 1, current: 1 });
  scale.current = {
    position: travelPerAngle, command: travelPerAngle,
    speed: lead > 0 ? travelPerAngle * description!.gear_ratio : 1,
    current: effort.scale,
  };

  useEffect(() => {
    let timer: ReturnType<typeof setTimeout>;
    const end = state.onLive((key, signals) => {
      if (key !== actuatorKey) return;
      setPeriod(signals.period);
      setSilent(false);
      clearTimeout(timer);
      timer = setTimeout(() => setSilent(true), 3000);
      if (paused.current || document.hidden) return;
      for (const { plot, isSeen, columns } of plots.current.values()) {
        // The first signals determine the size of the axes, even if the plot is not visible.
        if (!isSeen() && plot.data[0].length > 0) continue;
        const drawn = columns.map((name) => withGaps(signals.values[name], scale.current[name]));
        plot.setData([signals.time, ...drawn] as unknown as uPlot.AlignedData);
      }
    });
    return () => {
      clearTimeout(timer);
      end();
    };
  }, [actuatorKey]);

  const keep = (name: string, columns: Drawn["columns"]) =>
    (plot: uPlot | null, isSeen: () => boolean) => {
      if (plot) plots.current.set(name, { plot, isSeen, columns });
      else plots.current.delete(name);
    };
  const series = (label: string, stroke: string, dash?: number[]): uPlot.Series => ({
    label, stroke, width: 1.3, points: { show: false }, ...(dash ? { dash } : {}),
  });
  const note = period !== undefined && (
    <span class="live-note">
      {isSilent ? "no telemetry for 3 s" : `${significant(1 / period, 3)} samples per second`}{" "}
      <button type="button" onClick={() => setPaused(!isPaused)}>
        {isPaused ? "resume" : "pause"}
      </button>
    </span>
  );
  return (
    <Section title="Live telemetry" id="live" note={note}>
      {period === undefined && <Empty>No telemetry has been received since this page was opened.</Empty>}
      <div class="plots" hidden={period === undefined}>
        <figure>
          <figcaption><strong>{effort.name}</strong></figcaption>
          <Plot label={`The ${effort.name} of the last ten seconds`} height={190} x={X}
            y={`${effort.name} [${effort.unit}]`} series={[series(effort.name, "data")]} data={EMPTY} legend={false} xRange={xRange}
            onPlot={keep("current", ["current"])} />
        </figure>
        <figure>
          <figcaption><strong>{lead > 0 ? "speed of the rod" : "motor speed"}</strong></figcaption>
          <Plot label="Motor speed of the last ten seconds" height={190} x={X} y={lead > 0 ? "speed [mm/s]" : "speed [rad/s]"}
            series={[series("speed", "data")]} data={EMPTY} legend={false} xRange={xRange}
            onPlot={keep("speed", ["speed"])} />
        </figure>
        <figure>
          <figcaption>
            <strong>{lead > 0 ? "travel" : "angle"}</strong> <span class="key data">position</span>{" "}
            <span class="key model">command</span>
          </figcaption>
          <Plot label="Position and command of the last ten seconds" height={190} x={X}
            y={lead > 0 ? "travel [mm]" : "angle [rad]"} legend={false} xRange={xRange} data={[[], [], []]}
            series={[series("position", "data"), series("command", "model", [6, 4])]}
            onPlot={keep("angle", ["position", "command"])} />
        </figure>
      </div>
    </Section>
  );
}
