// SPDX-License-Identifier: Apache-2.0
// The comparison of a record, worded as in ema_monitor/joint/wording.py.

import { fixed, significant } from "./format.ts";
import type { QuantityChange } from "./messages.ts";
import registry from "./registry.json";

/** Values of `judgement`. */
const UNCHANGED = 0;
const CHANGED = 1;

const registered: Record<string, { label: string; reference: string }> = registry.quantities;

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
  return registered[name]?.label ?? name.replaceAll("_", " ");
}

/** Whether an estimate is the comparison of a record, to which no model is fitted. */
export function isOfRecord(estimate: { quantities?: readonly QuantityChange[] }): boolean {
  return (estimate.quantities?.length ?? 0) > 0;
}

/** Table rows for the quantities of an estimate; old recordings have no quantities. */
export function rowsOf(quantities: readonly QuantityChange[] | undefined): QuantityRow[] {
  return (quantities ?? []).map((quantity) => {
    const isJudged = quantity.judgement === UNCHANGED || quantity.judgement === CHANGED;
    const isKnown = Number.isFinite(quantity.change) && (isJudged || !quantity.rivals.length);
    const reference = registered[quantity.name]?.reference ?? "healthy";
    const suffix = reference === "healthy" ? "" : ` (of ${reference})`;
    return {
      name: quantity.name,
      label: labelOf(quantity.name) + suffix,
      change: isKnown ? `${signed(quantity, quantity.change)} ${unitOf(quantity)}` : "",
      interval: isKnown && Number.isFinite(quantity.low) && Number.isFinite(quantity.high)
        ? `${signed(quantity, quantity.low)} to ${signed(quantity, quantity.high)} ${unitOf(quantity)}` : "",
      judgement: judgementOf(quantity),
      isChanged: quantity.judgement === CHANGED,
    };
  });
}

function judgementOf(quantity: QuantityChange): string {
  if (quantity.judgement === CHANGED) {
    const rivals = quantity.rivals.map(labelOf).join(" or ");
    return rivals ? `changed (not distinguishable from ${rivals})` : "changed";
  }
  if (quantity.judgement !== UNCHANGED) return `not judged${quantity.reason && ` (${quantity.reason})`}`;
  if (!Number.isFinite(quantity.smallest_change)) return "unchanged";
  return `unchanged (changes above ${smallest(quantity)} ${unitOf(quantity)} would show)`;
}

function unitOf(quantity: QuantityChange): string {
  return quantity.unit === "-" ? "%" : quantity.unit;
}

function signed(quantity: QuantityChange, value: number): string {
  const text = quantity.unit === "-"
    ? fixed(100 * value, Math.abs(value) < 1 ? 1 : 0) : fixed(value, decimals(quantity.smallest_change));
  return text.startsWith("−") ? text : `+${text}`;
}

/** Number of decimals that shows two digits of the smallest change. */
function decimals(smallest: number): number {
  return smallest > 0 && smallest < Infinity ? Math.max(0, 1 - Math.floor(Math.log10(smallest))) : 3;
}

function smallest(quantity: QuantityChange): string {
  if (quantity.unit !== "-") return significant(quantity.smallest_change, 2);
  const scaled = 100 * quantity.smallest_change;
  return scaled < 10 ? String(Number(scaled.toPrecision(2))) : fixed(scaled, 0);
}
