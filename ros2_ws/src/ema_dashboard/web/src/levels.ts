// Levels of health in words. A shape and the word stand beside every colour.

export interface Level {
  word: string;
  name: "ok" | "warn" | "error" | "stale";
  rank: number; // the worst first
}

export const LEVELS: Level[] = [
  { word: "OK", name: "ok", rank: 3 },
  { word: "WARN", name: "warn", rank: 1 },
  { word: "ERROR", name: "error", rank: 0 },
  { word: "STALE", name: "stale", rank: 2 },
];

/** Of an actuator of which no health has come yet. */
export const UNKNOWN: Level = { word: "NO HEALTH", name: "stale", rank: 2.5 };
