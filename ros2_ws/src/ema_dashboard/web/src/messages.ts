// SPDX-License-Identifier: Apache-2.0
// The messages that the page reads, as decoded by @foxglove/rosmsg2-serialization. The units are
// defined in ema_interfaces/msg.

import type { Time } from "./interfaces.ts";

export type * from "./interfaces.ts";

export const OK = 0;
export const WARN = 1;
export const ERROR = 2;
export const STALE = 3;

export const VERDICTS = ["valid", "degraded", "refused", "failed", "skipped", "departed"] as const;
export const DEPARTED = VERDICTS.indexOf("departed");

export const ACTIONS = ["unknown", "continue", "inspect", "remove"] as const;

/** BaselineStatus.LEARNING. */
export const LEARNING_STATE = 0;

export const PLAYING = 0;
export const PAUSED = 1;
export const ENDED = 2;

/** Time in seconds since the epoch. */
export function seconds(time: Time): number {
  return time.sec + time.nanosec * 1e-9;
}

/** Time in nanoseconds since the epoch, exact. */
export function nanoseconds(time: Time): bigint {
  return BigInt(time.sec) * 1_000_000_000n + BigInt(time.nanosec);
}
