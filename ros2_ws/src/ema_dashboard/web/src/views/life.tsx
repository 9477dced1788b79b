// SPDX-License-Identifier: Apache-2.0
// Texts for remaining life, removal and the reason of a level.

import { lifeHours } from "../format.ts";
import { ERROR, OK, STALE, type Health, type RemainingUsefulLife } from "../messages.ts";

export const NO_DATE = "no date";
const SOON_HOURS = 0.5;
const LONGEST_REASON = 40;

/** Median and interval of a remaining life. */
export function Life({ life }: { life: RemainingUsefulLife }) {
  if (!life.known) {
    const isShort = life.reason && life.reason.length <= LONGEST_REASON;
    return <span class="soft" title={life.reason}>unknown{isShort && `: ${life.reason}`}</span>;
  }
  if (life.hours_95 <= 0) return <strong>none left</strong>;
  if (!Number.isFinite(life.hours_50)) {
    return <span>more than {lifeHours(life.hours_05, life)} h</span>;
  }
  return (
    <span class="life" title={`5 %, 50 %, 95 %, until ${life.criterion}`}>
      <strong>{lifeHours(life.hours_50, life)} h</strong>{" "}
      <span class="soft nowrap">
        {lifeHours(life.hours_05, life)} – {lifeHours(life.hours_95, life)} h
      </span>
    </span>
  );
}

/** Hours until the unit must be removed, for the accepted risk of failure; NaN without a date. */
function hoursToRemoval(health: Health): number {
  const level = health.level === STALE ? health.last_level : health.level;
  if (level === ERROR) return 0;
  if (!health.rul.known) return NaN;
  // Old recordings have no removal risk.
  return health.removal_risk > 0 ? health.removal_hours : health.rul.hours_05;
}

/** When to remove the unit: "now", "in 120 h" or "no date". */
export function whenToRemove(health: Health): string {
  const hours = hoursToRemoval(health);
  if (!Number.isFinite(hours)) return NO_DATE;
  return hours < SOON_HOURS ? "now" : `in ${lifeHours(hours, health.rul)} h`;
}

/** When to remove the unit, with the service hour. */
export function RemoveBefore({ health }: { health: Health }) {
  const hours = hoursToRemoval(health);
  const when = whenToRemove(health);
  if (!Number.isFinite(hours)) return <span class="soft">{when}</span>;
  if (hours < SOON_HOURS) return <strong>{when}</strong>;
  return (
    <span title={health.removal}>
      <strong>{when}</strong>{" "}
      <span class="soft nowrap">
        service {lifeHours(health.flight_hours + hours, health.rul)} h
      </span>
    </span>
  );
}

/** Reason for the level. */
export function why(health: Health): string {
  if (health.cause) return health.cause;
  if (health.level !== OK) return health.reason;
  const well = "no fault or requirement gives a warning";
  return health.reason ? `${well}; ${health.reason}` : well;
}
