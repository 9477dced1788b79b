// SPDX-License-Identifier: Apache-2.0
// Joints grouped by robot, worst first: level, friction with its trend, and other changes.

import { memo } from "preact/compat";
import type { FrictionTrend } from "../friction_trend.ts";
import { withSigma } from "../format.ts";
import {
  type Robot, frictionOf, isLearning, namesOf, otherChanges, robotsOf, temperatureOf,
} from "../joints.ts";
import type { BaselineStatus } from "../messages.ts";
import type { Actuator, State } from "../state.ts";
import { Progress } from "./baseline.tsx";
import { why } from "./life.tsx";
import { Badge, Shape, Since, classOf, levelOf, silence } from "./parts.tsx";
import { addressOf } from "./route.ts";

const rankOf = (joint: Actuator) => levelOf(joint).rank;

export function Joints({ state, joints, hasNamespace }: {
  state: State; joints: Actuator[]; hasNamespace: boolean;
}) {
  return (
    <div class="robots">
      {robotsOf(joints, rankOf).map((robot) => (
        <OneRobot key={robot.key} robot={robot} trends={state.trends} hasNamespace={hasNamespace} />
      ))}
    </div>
  );
}

function OneRobot({ robot, trends, hasNamespace }: {
  robot: Robot; trends: Map<string, FrictionTrend>; hasNamespace: boolean;
}) {
  const title = robot.name || "Joints";
  return (
    <section class="robot" aria-label={`Robot ${title}`} data-robot={robot.key}>
      <header>
        <h2>{title}</h2>
        {hasNamespace && <span class="soft">{robot.namespace || "/"}</span>}
        <span class="counts">{countsOf(robot).map(([level, count]) => (
          <span key={level.word} class="nowrap">
            <Shape level={level} size={16} /> {count} {level.word}
          </span>
        ))}</span>
      </header>
      <ul class="joints">
        {robot.joints.map((joint) => (
          <Joint key={joint.key} joint={joint} trend={trends.get(joint.key)} />
        ))}
      </ul>
    </section>
  );
}

/** Number of joints of a robot by level, worst level first. */
function countsOf({ joints }: Robot) {
  const counts = new Map<string, [ReturnType<typeof levelOf>, number]>();
  for (const level of joints.map(levelOf)) {
    counts.set(level.word, [level, (counts.get(level.word)?.[1] ?? 0) + 1]);
  }
  return [...counts.values()];
}

const Joint = memo(({ joint, trend }: { joint: Actuator; trend?: FrictionTrend }) => {
  const level = levelOf(joint);
  const learning = isLearning(joint) ? joint.baseline : undefined;
  return (
    <li class={`joint ${classOf(level)}`} data-joint={joint.key}>
      <div class="joint-head">
        <a href={addressOf(joint)}>{namesOf(joint.id).joint}</a>
        <Badge level={level} size={18} />
      </div>
      {learning ? <Learning joint={joint} baseline={learning} />
        : <Compared joint={joint} trend={trend} />}
      <Foot joint={joint} />
    </li>
  );
});

function Compared({ joint, trend }: { joint: Actuator; trend?: FrictionTrend }) {
  const friction = frictionOf(joint);
  const others = otherChanges(joint);
  const cause = joint.health && joint.health.level !== 0 ? why(joint.health) : "";
  return (
    <>
      {friction?.change ? (
        <p class="joint-friction">
          friction <strong>{friction.change}</strong>{" "}
          {friction.interval && <span class="soft nowrap">{friction.interval}</span>}
        </p>
      ) : (
        <p class="joint-friction soft">
          {friction ? `friction ${friction.judgement}` : "no record compared yet"}
        </p>
      )}
      {trend && trend.change.length > 1 && <Sparkline trend={trend} />}
      {others.length > 0 && (
        <ul class="joint-changes" aria-label="Other changes">
          {others.map(({ name, label, change }) => (
            <li key={name}><span class="soft">{label}</span> <strong>{change}</strong></li>
          ))}
        </ul>
      )}
      {cause && <p class="joint-cause">{silence(joint)}{cause}</p>}
    </>
  );
}

function Learning({ joint, baseline }: { joint: Actuator; baseline: BaselineStatus }) {
  // A failure while the joint learns, such as a blocked shaft.
  const alarm = levelOf(joint).name !== "learning" && joint.health ? why(joint.health) : "";
  return (
    <>
      {alarm && <p class="joint-cause">{silence(joint)}{alarm}</p>}
      <Progress baseline={baseline} isAdvised />
    </>
  );
}

function Foot({ joint }: { joint: Actuator }) {
  const temperature = temperatureOf(joint);
  if (!temperature && !joint.health) return null;
  return (
    <p class="joint-foot">
      {joint.health && <span>record <Since health={joint.health} suffix=" ago" /></span>}
      {temperature && (
        <span title="rise of the winding temperature">
          winding {temperature.value >= 0 && "+"}
          {withSigma(temperature.value, temperature.sigma)} K
        </span>
      )}
    </p>
  );
}

const [WIDTH, HEIGHT] = [240, 44];
const LEAST_TOP = 0.2; // noise must not look like a change

function Sparkline({ trend: { change, low, high } }: { trend: FrictionTrend }) {
  const top = Math.max(LEAST_TOP, ...high);
  const bottom = Math.min(-0.25 * LEAST_TOP, ...low);
  const x = (i: number) => ((i * WIDTH) / (change.length - 1)).toFixed(1);
  const y = (value: number) => (HEIGHT * (top - value) / (top - bottom)).toFixed(1);
  const points = (values: number[]) => values.map((value, i) => `${x(i)} ${y(value)}`);
  const band = [...points(high), ...points(low).reverse()].join(" L");
  const last = change.at(-1)!;
  return (
    <svg class="sparkline" viewBox={`0 0 ${WIDTH} ${HEIGHT}`} preserveAspectRatio="none" role="img"
      aria-label={`Friction trend: from ${inPercent(change[0]!)} to ${inPercent(last)}`}>
      <path class="band" d={`M${band} Z`} />
      <path class="zero" d={`M0 ${y(0)} H${WIDTH}`} />
      <path class="line" d={`M${points(change).join(" L")}`} />
    </svg>
  );
}

const inPercent = (share: number) => `${(100 * share).toFixed(0)} %`;
