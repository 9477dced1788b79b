// SPDX-License-Identifier: Apache-2.0
// Levels of health. Every colour is accompanied by a shape and a word.

type LevelName = "ok" | "warn" | "error" | "stale";

export interface Level {
  word: string;
  name: LevelName | "learning";
  rank: number; // 0 is the worst
  isOld?: boolean; // it is the last known level
}

/** Levels of health, indexed by their number in Health.msg. */
export const LEVELS: (Level & { name: LevelName })[] = [
  { word: "OK", name: "ok", rank: 3 },
  { word: "WARN", name: "warn", rank: 1 },
  { word: "ERROR", name: "error", rank: 0 },
  { word: "STALE", name: "stale", rank: 2 },
];

/** Level of an actuator without a received health. */
export const UNKNOWN: Level = { word: "NO HEALTH", name: "stale", rank: 2.5 };

/** Level of a joint whose healthy records are being collected. */
export const LEARNING: Level = { word: "LEARNING", name: "learning", rank: 2.7 };

/** The level to show. While the level is unknown, the last warning or error is shown, marked as old. */
export function levelNow(level: number, last: number, isSilent = false): Level {
  const [, warn, error, stale] = LEVELS;
  const lastKnown = level === 3 ? last : level;
  if (level !== 3 && !isSilent) return LEVELS[level] ?? UNKNOWN;
  const alarm = lastKnown === 2 ? error! : lastKnown === 1 ? warn! : undefined;
  return alarm ? { ...alarm, word: `${alarm.word}, old`, isOld: true } : stale!;
}
