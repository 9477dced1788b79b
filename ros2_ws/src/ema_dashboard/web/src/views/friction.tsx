// SPDX-License-Identifier: Apache-2.0
// Plot of friction over speed: the band of a joint's healthy records, and its latest record.

import { useMemo } from "preact/hooks";
import type uPlot from "uplot";
import { dateTime } from "../format.ts";
import { picture } from "../friction_curve.ts";
import { type ActuatorDescription, type FrictionCurve, seconds } from "../messages.ts";
import { Section } from "./parts.tsx";
import { type Colour, Plot } from "./plot.tsx";

export function FrictionOverSpeed({ curve, description }: {
  curve?: FrictionCurve; description?: ActuatorDescription;
}) {
  const built = useMemo(() => curve && picture(curve), [curve]);
  if (!curve || !built || built.covered === 0) return null;
  const speedUnit = description && description.lead > 0 ? "m/s" : "rad/s";
  const series: uPlot.Series[] = [
    ...["backward", "forward"].flatMap((direction): uPlot.Series[] => [
      { label: `healthy, 95 %, ${direction}`, stroke: "interval", width: 1, points: { show: false } },
      { label: `healthy, 5 %, ${direction}`, stroke: "interval", width: 1, points: { show: false } },
      {
        label: `latest record, ${direction}`, stroke: "data", width: 2.5,
        points: { show: true, size: 6, fill: "data" },
      },
    ]),
    {
      label: "outside the band", stroke: "limit", width: 0,
      points: { show: true, size: 10, fill: "card", width: 2 },
    },
  ];
  const outside = built.judged === 0 ? "the healthy records do not cover these speeds"
    : `${built.outside} of ${built.judged} speeds outside the healthy band`;
  return (
    <Section title="Friction over speed" id="friction"
      note={<>record that ended {dateTime(seconds(curve.header.stamp))}; band: healthy, 90 %</>}>
      <p class="soft">{outside}</p>
      <Plot label={`Friction over speed of the latest record: ${outside}`} height={300}
        x={`speed [${speedUnit}]`} y={`friction [${curve.unit}]`} series={series} data={built.columns as uPlot.AlignedData}
        bands={[{ series: [1, 2], fill: "band" }, { series: [4, 5], fill: "band" }]} legend={false} draw={directions} />
    </Section>
  );
}

function directions(plot: uPlot, colour: Colour): void {
  const { ctx } = plot;
  const { left, top, width, height } = plot.bbox;
  const ratio = devicePixelRatio;
  ctx.save();
  ctx.fillStyle = colour("ink-soft");
  ctx.font = `${13 * ratio}px system-ui, sans-serif`;
  ctx.textAlign = "left";
  ctx.textBaseline = "top";
  ctx.fillText("← backward", left + 8 * ratio, top + 4 * ratio);
  ctx.textAlign = "right";
  ctx.textBaseline = "bottom";
  ctx.fillText("forward →", left + width - 8 * ratio, top + height - 4 * ratio);
  ctx.restore();
}
