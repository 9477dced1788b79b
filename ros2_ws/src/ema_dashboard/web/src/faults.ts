// SPDX-License-Identifier: Apache-2.0
// The registries of faults and hidden causes, from src/registry.json.

import { decimalsOf, fixed, percent, significant } from "./format.ts";
import type { ActuatorDescription } from "./messages.ts";
import registry from "./registry.json";

export type Fault = (typeof registry.faults)[number];

export const FAULTS: Fault[] = registry.faults;
export const ASSESSED = FAULTS.filter((fault) => fault.assessed);

/** DRIVE_UNKNOWN of ActuatorDescription. */
export const UNKNOWN_DRIVE = 2;

/** Faults that can be identified from records of an unknown drive. */
const OF_RECORDS = new Set(["friction", "backlash"]);

/** Units of the effort by `effort_kind` of the description. */
const EFFORT_UNITS = ["A", "N.m", "N"];

const byName = new Map(FAULTS.map((fault) => [fault.name, fault]));
const causes: Record<string, string> = registry.causes;
const quantities: Record<string, { label: string }> = registry.quantities;

/** Label of a fault, requirement, hidden cause or quantity. */
export function labelOf(name: string): string {
  return byName.get(name)?.label ?? causes[name] ?? quantities[name]?.label ??
    name.replaceAll("_", " ");
}

export function faultOf(name: string): Fault | undefined {
  return byName.get(name);
}

/** Whether a fault can be identified for the drive of an actuator. */
export function isShown(name: string, description?: ActuatorDescription): boolean {
  return description?.drive !== UNKNOWN_DRIVE || OF_RECORDS.has(name);
}

/** The measured effort: its name, its unit, and the effort for 1 A of telemetry. */
export function effortOf(description?: ActuatorDescription): {
  name: string; unit: string; scale: number;
} {
  const kind = description?.drive === UNKNOWN_DRIVE ? description.effort_kind ?? 0 : 0;
  if (!description || kind === 0) return { name: "current", unit: "A", scale: 1 };
  const torque = description.torque_constant / description.gear_ratio;
  if (kind === 1) return { name: "torque", unit: EFFORT_UNITS[kind]!, scale: torque };
  const scale = description.lead > 0 ? (2 * Math.PI * torque) / description.lead : torque;
  return { name: "force", unit: EFFORT_UNITS[2]!, scale };
}

/** A normalised fault as a change from healthy; as a share if the healthy value is 0. */
export function inPercent(fault: Fault, value: number): string {
  if (!Number.isFinite(value)) return "–";
  const nominal = fault.base + fault.slope * fault.healthy;
  if (nominal === 0) return percent(fault.slope * value, 2);
  const change = (fault.slope * (value - fault.healthy)) / nominal;
  if (change > 2) return `× ${fixed(1 + change, 1)}`;
  return change < 0 ? `−${percent(-change, 2)}` : `+${percent(change, 2)}`;
}

/** A normalised fault in physical units, rounded to the precision of its standard deviation. */
export function physical(
  fault: Fault, value: number, sigma: number, unit?: ActuatorDescription,
): string {
  const scaled = Math.abs(fault.slope) * sigma;
  const digits = Number.isFinite(scaled) && scaled > 0 ? decimalsOf(scaled) : 3;
  const at = fault.base + fault.slope * value;
  const words = `${fault.quantity} ${at.toFixed(digits)} ${fault.unit}`.trim();
  return words + atTheRod(fault, fault.slope * (value - fault.healthy), unit);
}

/** Growth of a fault of a linear actuator at the rod, in mm or N; "" for other actuators. */
function atTheRod(fault: Fault, growth: number, unit?: ActuatorDescription): string {
  if (!unit || !(unit.lead > 0)) return "";
  const travelPerAngle = (unit.lead / (2 * Math.PI)) * unit.gear_ratio;
  const growthText = (amount: number, name: string) =>
    `, ${amount < 0 ? "−" : "+"}${significant(Math.abs(amount), 3)} ${name}`;
  if (fault.name === "backlash") return growthText(1e3 * growth * unit.backlash * travelPerAngle, "mm");
  if (fault.name !== "friction" || unit.drive === UNKNOWN_DRIVE) return "";
  return growthText((growth * (unit.motor_static_friction + unit.user_static_friction)) / travelPerAngle, "N");
}
