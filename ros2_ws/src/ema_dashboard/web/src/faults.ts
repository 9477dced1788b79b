// The registries of faults and hidden causes, as src/registry.json has them.

import { decimalsOf } from "./format.ts";
import registry from "./registry.json";

export type Fault = (typeof registry.faults)[number];

export const FAULTS: Fault[] = registry.faults;
export const ASSESSED = FAULTS.filter((fault) => fault.assessed);

const byName = new Map(FAULTS.map((fault) => [fault.name, fault]));
const causes: Record<string, string> = registry.causes;

/** A name of a fault, requirement or hidden cause in words. */
export function labelOf(name: string): string {
  return byName.get(name)?.label ?? causes[name] ?? name.replaceAll("_", " ");
}

export function faultOf(name: string): Fault | undefined {
  return byName.get(name);
}

/** The physical meaning of a normalised value, with the digits that its sigma leaves. */
export function physical(fault: Fault, value: number, sigma: number): string {
  const scaled = Math.abs(fault.slope) * sigma;
  const digits = Number.isFinite(scaled) && scaled > 0 ? decimalsOf(scaled) : 3;
  const at = fault.base + fault.slope * value;
  return `${fault.quantity} ${at.toFixed(digits)} ${fault.unit}`.trim();
}
