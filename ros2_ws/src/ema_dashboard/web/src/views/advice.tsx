// SPDX-License-Identifier: Apache-2.0
// Recommended action for the actuator, and its cost.

import type { ComponentChildren } from "preact";
import { hours, percent, significant } from "../format.ts";
import { ACTIONS, type Advice, type Health } from "../messages.ts";
import { NO_DATE, whenToRemove } from "./life.tsx";

const WHAT: Record<string, (at: string) => string> = {
  continue: (at) => `Continue, and decide again ${at}`,
  inspect: (at) => `Inspect ${at}`,
  remove: (at) => `Remove ${at}`,
};

/** Whether the screen is as narrow as a phone's, on which long texts are folded. */
export const isPhone = () => matchMedia("(max-width: 40rem)").matches;

/** Text that is folded on a phone until its title is tapped. */
export function Folded({ title, children }: { title: string; children: ComponentChildren }) {
  return isPhone() ? <details><summary>{title}</summary>{children}</details> : <>{children}</>;
}

function removalHeadline(health: Health): string {
  const when = whenToRemove(health);
  return when === NO_DATE ? "No removal date yet" : `Remove ${when}`;
}

/** Recommended inspection of a departed unit, advice if costs are set, and time of removal. */
export function WhatToDo({ advice, health, isDeparted }: {
  advice?: Advice; health: Health; isDeparted: boolean;
}) {
  const look = isDeparted && (
    <p class="what"><strong>Check the unit:</strong> its latest test differs from healthy tests.</p>
  );
  const action = ACTIONS[advice?.action ?? 0] ?? "unknown";
  if (!advice || action === "unknown") {
    return health.removal ? (
      <div class="todo">
        <h2>What to do</h2>
        {look}
        <p class="what"><strong>{removalHeadline(health)}</strong></p>
        <Folded title="Why"><p class="removal">{health.removal}</p></Folded>
      </div>
    ) : null;
  }
  const when = Number.isFinite(advice.flight_hours)
    ? `${action === "continue" ? "at" : "by"} ${hours(advice.flight_hours)} service hours` : "";
  const unit = `${advice.cost_unit} per service hour`.trim();
  const saved = 1 - advice.expected_cost / advice.cost_of_immediate_removal;
  return (
    <div class="todo">
      <h2>What to do</h2>
      {look}
      <p class="what">
        <strong>{WHAT[action]!(when)}</strong>
        {Number.isFinite(advice.from_now) && <span class="soft"> in {hours(advice.from_now)} h</span>}
      </p>
      <Folded title="Why, and at what cost">
        {advice.reason && <p>{advice.reason}</p>}
        <p class="removal">{health.removal}</p>
        {Number.isFinite(advice.expected_cost) && (
          <p class="soft">
            {significant(advice.expected_cost, 3)} {unit}; if removed immediately,{" "}
            {significant(advice.cost_of_immediate_removal, 3)}
            {Number.isFinite(saved) && saved > 0 && ` (${percent(saved)} less)`};{" "}
            {percent(advice.probability_of_failure)} risk of failure until then
          </p>
        )}
      </Folded>
    </div>
  );
}
