// SPDX-License-Identifier: Apache-2.0
// The comparison of a record, worded as in ema_monitor/joint/wording.py.

import { fixed, significant } from "./format.ts";
import type { QuantityChange } from "./messages.ts";
import registry from "./registry.json";

/** Values of `judgement`. */
const UNCHANGED = 0;
const CHANGED = 1;

const known: Record<string, { label: string; reference: string }> = registry.quantities;

export interface QuantityRow {
  name: string;
  label: string;
  change: string;
  interval: string;
  judgement: string;
  isChanged: boolean;
}

/** Label of a quantity. */
function labelOf(name: string): string {
  return known[name]?.label ?? name.replaceAll("_", " ");
}

/** Whether an estimate is the comparison of a record, to which no model is fitted. */
export function isOfRecord(estimate: { quantities?: readonly QuantityChange[] }): boolean {
  return (estimate.quantities?.length ?? 0) > 0;
}

/** Table rows for the quantities of an estimate; old recordings have no quantities. */
export function rowsOf(quantities: readonly QuantityChange[] | undefined): QuantityRow[] {
  return (quantities ?? []).map((one) => {
    const isJudged = one.judgement === UNCHANGED || one.judgement === CHANGED;
    const isKnown = Number.isFinite(one.change) && (isJudged || !one.rivals.length);
    const reference = known[one.name]?.reference ?? "healthy";
    const of = reference === "healthy" ? "" : ` (of ${reference})`;
    return {
      name: one.name,
      label: labelOf(one.name) + of,
      change: isKnown ? `${signed(one, one.change)} ${unitOf(one)}` : "",
      interval: isKnown && Number.isFinite(one.low) && Number.isFinite(one.high)
        ? `${signed(one, one.low)} to ${signed(one, one.high)} ${unitOf(one)}` : "",
      judgement: judgementOf(one),
      isChanged: one.judgement === CHANGED,
    };
  });
}

function judgementOf(one: QuantityChange): string {
  if (one.judgement === CHANGED) {
    const rivals = one.rivals.map(labelOf).join(" or ");
    return rivals ? `changed (not distinguishable from ${rivals})` : "changed";
  }
  if (one.judgement !== UNCHANGED) return `not judged${one.reason && ` (${one.reason})`}`;
  if (!Number.isFinite(one.smallest_change)) return "unchanged";
  return `unchanged (changes above ${smallest(one)} ${unitOf(one)} would show)`;
}

function unitOf(one: QuantityChange): string {
  return one.unit === "-" ? "%" : one.unit;
}

function signed(one: QuantityChange, value: number): string {
  const text = one.unit === "-"
    ? fixed(100 * value, Math.abs(value) < 1 ? 1 : 0) : fixed(value, decimals(one.smallest_change));
  return text.startsWith("−") ? text : `+${text}`;
}

/** Number of decimals that shows two digits of the smallest change. */
function decimals(smallest: number): number {
  return smallest > 0 && smallest < Infinity ? Math.max(0, 1 - Math.floor(Math.log10(smallest))) : 3;
}

function smallest(one: QuantityChange): string {
  if (one.unit !== "-") return significant(one.smallest_change, 2);
  const scaled = 100 * one.smallest_change;
  return scaled < 10 ? String(Number(scaled.toPrecision(2))) : fixed(scaled, 0);
}
