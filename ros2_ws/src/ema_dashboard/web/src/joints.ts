// SPDX-License-Identifier: Apache-2.0
// Joints: units with an unknown drive, whose records are compared with their healthy records.

import { UNKNOWN_DRIVE } from "./faults.ts";
import { type BaselineStatus, LEARNING_STATE } from "./messages.ts";
import { type QuantityRow, rowsOf } from "./quantities.ts";
import type { Actuator } from "./state.ts";

const FRICTION = "friction";
const TEMPERATURE = "winding_temperature";

export function isJoint({ baseline, description }: Actuator): boolean {
  return baseline !== undefined || description?.drive === UNKNOWN_DRIVE;
}

export function isLearning({ baseline }: Actuator): boolean {
  return baseline?.state === LEARNING_STATE;
}

/** Robot and joint of an actuator_id such as `left/elbow`; the robot is "" if the id has no slash. */
export function namesOf(id: string): { robot: string; joint: string } {
  const at = id.lastIndexOf("/");
  return at > 0 ? { robot: id.slice(0, at), joint: id.slice(at + 1) } : { robot: "", joint: id };
}

/** The friction of the latest usable record, compared with the healthy records. */
export function frictionOf({ usable }: Actuator): QuantityRow | undefined {
  return rowsOf(usable?.quantities).find(({ name }) => name === FRICTION);
}

/** The changed quantities other than friction. */
export function otherChanges({ usable }: Actuator): QuantityRow[] {
  return rowsOf(usable?.quantities).filter(({ name, isChanged }) => isChanged && name !== FRICTION);
}

/** Measured rise of the winding temperature in the latest record [K]. */
export function temperatureOf({ estimate }: Actuator): { value: number; sigma: number } | undefined {
  return estimate?.measured.find(({ name }) => name === TEMPERATURE);
}

export interface Robot {
  key: string;
  namespace: string;
  name: string; // empty for joints without a robot name
  joints: Actuator[]; // worst first
}

/** Joints grouped by robot; robots are ordered by their worst joint, and by how many are that bad. */
export function robotsOf(joints: Actuator[], rankOf: (joint: Actuator) => number): Robot[] {
  const robots = new Map<string, Robot>();
  for (const joint of [...joints].sort((a, b) => byWorst(a, b, rankOf))) {
    const name = namesOf(joint.id).robot;
    const key = `${joint.namespace}/${name}`;
    const robot = robots.get(key) ?? { key, namespace: joint.namespace, name, joints: [] };
    robot.joints.push(joint);
    robots.set(key, robot);
  }
  const worst = ({ joints: [first] }: Robot) => rankOf(first!);
  const countOf = (robot: Robot) => robot.joints.filter((joint) => rankOf(joint) === worst(robot)).length;
  return [...robots.values()].sort((a, b) =>
    worst(a) - worst(b) || countOf(b) - countOf(a) || natural(a.key, b.key));
}

/** Order by level, significant change of friction, and name, so that noise does not move cells. */
function byWorst(a: Actuator, b: Actuator, rankOf: (joint: Actuator) => number): number {
  return rankOf(a) - rankOf(b) || increaseOf(b) - increaseOf(a) ||
    natural(a.key, b.key);
}

function increaseOf(joint: Actuator): number {
  const friction = joint.usable?.quantities?.find(({ name }) => name === FRICTION);
  return friction && frictionOf(joint)?.isChanged ? friction.change : -Infinity;
}

const collator = new Intl.Collator("en", { numeric: true });

function natural(a: string, b: string): number {
  return collator.compare(a, b);
}

/** Smallest detectable changes of friction, as a sentence; "" while they are unknown. */
export function detectableText(baseline: BaselineStatus): string {
  const [same, other] = [baseline.detectable_same_day, baseline.detectable_other_day]
    .map(inPercent);
  if (!same && !other) return "";
  if (!other) return `friction changes above ${same} would show`;
  if (!same || same === other) return `friction changes above ${other} would show`;
  return `friction changes above ${same} would show, above ${other} on another day`;
}

/** A smallest detectable change in per cent; "" if it is unknown. */
export function inPercent(share: number): string {
  if (!Number.isFinite(share)) return "";
  const scaled = 100 * share;
  return `${scaled < 10 ? Number(scaled.toPrecision(2)) : Math.round(scaled)}\u00a0%`;
}

/** Numbers of records and days of a baseline, as text. */
export function countsText({ state, records, records_needed, days }: BaselineStatus): string {
  const needed = state === LEARNING_STATE && records_needed > 0 ? ` of ${records_needed}` : "";
  const last = records_needed > 0 && state === LEARNING_STATE ? records_needed : records;
  return `${records}${needed} ${last === 1 ? "record" : "records"} on ${days} ` +
    (days === 1 ? "day" : "days");
}
