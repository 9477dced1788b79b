// SPDX-License-Identifier: Apache-2.0
// Levels of health in words. A shape and the word stand beside every colour.

type LevelName = "ok" | "warn" | "error" | "stale";

export interface Level {
  word: string;
  name: LevelName | "learning";
  rank: number; // the worst first
  isOld?: boolean; // it was the last one that was known
}

/** Levels of a health, by their numbers. */
export const LEVELS: (Level & { name: LevelName })[] = [
  { word: "OK", name: "ok", rank: 3 },
  { word: "WARN", name: "warn", rank: 1 },
  { word: "ERROR", name: "error", rank: 0 },
  { word: "STALE", name: "stale", rank: 2 },
];

/** Of an actuator of which no health has come yet. */
export const UNKNOWN: Level = { word: "NO HEALTH", name: "stale", rank: 2.5 };

/** Of a joint whose healthy records are being collected: it has no level. */
export const LEARNING: Level = { word: "LEARNING", name: "learning", rank: 2.7 };

/** What a level is worth now: a warning or an error that nobody confirms any more stays, as old. */
export function levelNow(level: number, last: number, isSilent = false): Level {
  const [, warn, error, stale] = LEVELS;
  const known = level === 3 ? last : level;
  if (level !== 3 && !isSilent) return LEVELS[level] ?? UNKNOWN;
  const alarm = known === 2 ? error! : known === 1 ? warn! : undefined;
  return alarm ? { ...alarm, word: `${alarm.word}, old`, isOld: true } : stale!;
}
