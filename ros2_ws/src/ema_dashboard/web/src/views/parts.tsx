// SPDX-License-Identifier: Apache-2.0
// Small components shared by several views.

import type { ComponentChildren } from "preact";
import { duration } from "../format.ts";
import { isLearning } from "../joints.ts";
import { LEARNING, LEVELS, type Level, UNKNOWN, levelNow } from "../levels.ts";
import { ERROR, type Health, OK, STALE, WARN, seconds } from "../messages.ts";
import type { Actuator } from "../state.ts";
import { useApp, useSecond } from "./hooks.ts";

export function levelOf(actuator: Actuator): Level {
  const { health, isSilent } = actuator;
  // A joint that is learning has no level unless it fails.
  const isAlarm = health?.level === WARN || health?.level === ERROR;
  if (isLearning(actuator) && !isAlarm && !isSilent) return LEARNING;
  if (!health) return UNKNOWN;
  return levelNow(health.level, health.last_level, isSilent);
}

/** Level of a fault or requirement: STALE instead of OK while the dashboard is silent. */
export function itemLevel({ isSilent }: Actuator, level: number): Level {
  return LEVELS[isSilent && level === OK ? STALE : level] ?? UNKNOWN;
}

/** Text with the last known level if the level is stale or the dashboard silent; else "". */
export function silence({ health, isSilent }: Actuator): string {
  if (!health || !(isSilent || health.level === STALE)) return "";
  const { word } = LEVELS[health.last_level] ?? UNKNOWN;
  const last = health.last_level === STALE ? "" : `the last known level is ${word}; `;
  return isSilent ? `no message from the dashboard; ${last}` : last;
}

// A shape for each level, so that levels can be distinguished without colour: disc, triangle, octagon,
// ring, square.
const SHAPES = {
  ok: (
    <>
      <circle cx="12" cy="12" r="10" class="shape" />
      <path d="M7 12.5 l3.5 3.5 L17 8.5" class="sign" />
    </>
  ),
  warn: (
    <>
      <path d="M12 2 L23 21.5 H1 Z" class="shape" />
      <path d="M12 9 V14.5 M12 17.2 V18.6" class="sign" />
    </>
  ),
  error: (
    <>
      <path d="M7.5 1.5 h9 l6 6 v9 l-6 6 h-9 l-6 -6 v-9 Z" class="shape" />
      <path d="M8 8 L16 16 M16 8 L8 16" class="sign" />
    </>
  ),
  stale: (
    <>
      <circle cx="12" cy="12" r="9.5" class="shape" stroke-dasharray="4 2.5" />
      <path d="M12 6.5 V12.5 L16 14.5" class="sign" />
    </>
  ),
  learning: (
    <>
      <rect x="2" y="2" width="20" height="20" rx="4" class="shape" />
      <path d="M7 17 V14 M12 17 V10.5 M17 17 V7" class="sign" />
    </>
  ),
};

export function classOf(level: Level): string {
  return level.isOld ? `${level.name} old` : level.name;
}

export function Shape({ level, size = 24 }: { level: Level; size?: number }) {
  return (
    <svg class={`level-shape ${classOf(level)}`} width={size} height={size} viewBox="0 0 24 24"
      aria-hidden="true">
      {SHAPES[level.name]}
    </svg>
  );
}

export function Badge({ level, large = false, size = large ? 36 : 22 }: {
  level: Level; large?: boolean; size?: number;
}) {
  return (
    <span class={`badge ${classOf(level)} ${large ? "large" : ""}`}>
      <Shape level={level} size={size} />
      <span>{level.word}</span>
    </span>
  );
}

/** Time since the latest test, updated every second. */
export function Since({ health, suffix = "" }: { health?: Health; suffix?: string }) {
  const { state } = useApp();
  useSecond();
  if (!health) return <>–</>;
  return <>{duration(state.now() - seconds(health.header.stamp))}{suffix}</>;
}

export function Section({ title, note, id, children }: {
  title: string; note?: ComponentChildren; id: string; children: ComponentChildren;
}) {
  return (
    <section class="card" aria-labelledby={id}>
      <header class="card-head">
        <h2 id={id}>{title}</h2>
        {note && <div class="note">{note}</div>}
      </header>
      {children}
    </section>
  );
}

export function Empty({ children }: { children: ComponentChildren }) {
  return <p class="empty">{children}</p>;
}

export function Figure({ label, children, note }: {
  label: string; children: ComponentChildren; note?: ComponentChildren;
}) {
  return (
    <div class="figure">
      <dt>{label}</dt>
      <dd>
        <strong>{children}</strong>
        {note && <small>{note}</small>}
      </dd>
    </div>
  );
}

/** A share from 0 to 1 as a bar; the number is shown next to it. */
export function Bar({ share, level }: { share: number; level: Level }) {
  const width = `${100 * Math.min(Math.max(Number.isFinite(share) ? share : 0, 0), 1)}%`;
  return (
    <span class={`bar ${level.name}`} aria-hidden="true">
      <span style={{ width }} />
    </span>
  );
}
