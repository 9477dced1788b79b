// SPDX-License-Identifier: Apache-2.0
// Summary of an archive's fleet, as served by the dashboard.

import type { Health, RemainingUsefulLife } from "./interfaces";

const ADDRESS = "fleet.json";

export interface Levels {
  units: number;
  ok: number;
  warn: number;
  error: number;
  stale: number;
}

type OrNull<T> = { [Name in keyof T]: T[Name] | null };

type OfHealth = OrNull<Pick<
  Health, "dominant_fault" | "health_index" | "removal_hours" | "flight_hours"
>>;

export interface WorstUnit extends OfHealth {
  model: string;
  actuator_id: string;
  serial_number: string;
  health: "OK" | "WARN" | "ERROR" | "STALE";
  last_health: WorstUnit["health"] | null; // level of its latest valid test
  rul: OrNull<RemainingUsefulLife>;
  tested: string;
}

export interface OfModel extends Levels {
  model: string;
  health_index: number | null;
  rul_50: number | null;
  flight_hours: number | null;
}

export interface OfAge extends Levels {
  from_hours: number;
  to_hours: number;
  health_index: number | null;
}

export interface Step {
  age: number;
  at_risk: number;
  failed: number;
  share: number;
  lower: number | null;
  upper: number | null;
}

export interface Summary {
  archive: string;
  bags: Record<"bags" | "damaged" | "incomplete" | "failed" | "unread", number> & {
    unreadable: string[];
  };
  levels: Levels & { latest_test: string | null };
  worst: WorstUnit[];
  models: OfModel[];
  ages: OfAge[];
  survival: Step[];
  lives: number;
  failures: number;
  longest_age: number;
  calibrations: { age: string; units: number }[];
  recent: { days: number; tested: number; units: number }[];
  months: { month: string; tested: number; units: number; windows: number; valid: number }[];
}

/** Fetch the summary with at most `most` units and models; null if the dashboard has no archive. */
export async function fetchSummary(most: number): Promise<Summary | null> {
  const answer = await fetch(`${ADDRESS}?most=${most}`);
  const content = await answer.json().catch(() => ({})) as Summary | { reason?: string };
  if (!answer.ok) {
    const reason = "reason" in content ? content.reason : undefined;
    throw new Error(reason ?? `the dashboard responded with status ${answer.status}`);
  }
  return (content as { archive: string | null }).archive === null ? null : content as Summary;
}

/** Numbers of bags that are missing or incomplete in the tables, as a sentence; "" if none is. */
export function bagsText({ bags }: Summary): string {
  const parts = ([
    ["damaged", "cannot be read"],
    ["incomplete", "can be read only in part"],
    ["failed", "could not be read in the last run"],
    ["unread", "not read yet"],
  ] as const).filter(([name]) => bags[name]).map(([name, what]) => `${bags[name]} ${what}`);
  if (!parts.length) return "";
  const words = `Of ${bags.bags} bag${bags.bags === 1 ? "" : "s"}: ${parts.join(", ")}`;
  const { unreadable } = bags;
  return unreadable.length ? `${words}. Unreadable: ${unreadable.join(", ")}` : words;
}

/**
 * Columns of the survival curve: age, share and its 90 % interval. The curve starts at a share of 1
 * and extends to the longest observed age.
 */
export function curveOf({ survival, longest_age }: Summary): (number | null)[][] {
  const last = survival.at(-1);
  const rows: (number | null)[][] = [[0, 1, 1, 1]];
  for (const { age, share, lower, upper } of survival) rows.push([age, share, lower, upper]);
  if (longest_age > (last?.age ?? 0)) {
    const { share, lower, upper } = last ?? { share: 1, lower: 1, upper: 1 };
    rows.push([longest_age, share, lower, upper]);
  }
  return [0, 1, 2, 3].map((k) => rows.map((row) => row[k]!));
}
