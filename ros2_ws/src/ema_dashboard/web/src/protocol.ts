// SPDX-License-Identifier: Apache-2.0
// Messages between worker and page.

import type { FrictionTrend } from "./friction_trend.ts";
import type { HistoryColumns } from "./unit_history.ts";
import type { LiveSignals } from "./telemetry.ts";

/** An actuator of a namespace. */
export interface Address {
  namespace: string;
  id: string;
}

export function keyOf(address: Address): string {
  return `${address.namespace}/${address.id}`;
}

export type Connection =
  | { state: "connecting" }
  | { state: "open" }
  | { state: "closed"; reason: string; retryAt: number }
  | { state: "refused"; reason: string; retryAt: number };

export interface Received {
  namespace: string;
  topic: string;
  message: unknown;
}

export type FromWorker =
  | { kind: "connection"; connection: Connection }
  | { kind: "session" } // a new server: discard all data
  | { kind: "channels"; topics: string[] }
  | { kind: "messages"; received: Received[] }
  | { kind: "history"; key: string; columns: HistoryColumns }
  | { kind: "trends"; trends: Map<string, FrictionTrend> } // of joints, by key
  | { kind: "live"; key: string; signals: LiveSignals };

export type ToWorker =
  | { kind: "watch"; address: Address | null }
  | { kind: "play"; play: boolean; rate: number; seek?: bigint }
  | { kind: "retry" };
