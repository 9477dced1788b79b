// SPDX-License-Identifier: Apache-2.0
// Texts for remaining life, removal and the reason of a level.

import { lifeHours } from "../format.ts";
import { ERROR, OK, STALE, type Health, type RemainingUsefulLife } from "../messages.ts";

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

/** Service hour by which to remove the unit, for the accepted risk of failure. */
export function RemoveBefore({ health }: { health: Health }) {
  const level = health.level === STALE ? health.last_level : health.level;
  if (level === ERROR) return <strong>now</strong>;
  const life = health.rul;
  // Old recordings have no removal risk.
  const hours = health.removal_risk > 0 ? health.removal_hours : life.hours_05;
  if (!life.known || !Number.isFinite(hours)) return <span class="soft">no date</span>;
  if (hours < SOON_HOURS) return <strong>now</strong>;
  return (
    <span title={health.removal}>
      <strong>in {lifeHours(hours, life)} h</strong>{" "}
      <span class="soft nowrap">service {lifeHours(health.flight_hours + hours, life)} h</span>
    </span>
  );
}

/** Reason for the level, without the leading `label` if that is shown next to it. */
export function why(health: Health, label = ""): string {
  if (health.cause) {
    return label && health.cause.startsWith(`${label} `)
      ? health.cause.slice(label.length + 1) : health.cause;
  }
  if (health.level !== OK) return health.reason;
  const well = "no fault or requirement gives a warning";
  return health.reason ? `${well}; ${health.reason}` : well;
}
