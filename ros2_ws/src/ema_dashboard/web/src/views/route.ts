// SPDX-License-Identifier: Apache-2.0
// The route: the part of the address after #, which survives a reload.

import { useEffect, useState } from "preact/hooks";
import type { Address } from "../protocol.ts";

export function addressOf({ namespace, id }: Address): string {
  return `#/actuator/${encodeURIComponent(namespace)}/${encodeURIComponent(id)}`;
}

export const ARCHIVE = "#/archive";

/** Titles of the parts of an actuator's page, by their name in the address. */
export const PARTS = {
  faults: "Faults", life: "Life", test: "Last test", evidence: "Evidence", telemetry: "Telemetry",
  events: "Events",
};
export type Part = keyof typeof PARTS;

export interface Place extends Address {
  part: Part;
}

export function parse(hash: string): Place | null {
  const [, name, namespace, id, part] = hash.replace(/^#/, "").split("/");
  if (name !== "actuator" || namespace === undefined || id === undefined) return null;
  try {
    return {
      namespace: decodeURIComponent(namespace), id: decodeURIComponent(id),
      part: part !== undefined && part in PARTS ? part as Part : "faults",
    };
  } catch {
    return null;
  }
}

/** The current route: an actuator, the archive, or null for the overview. */
export function useRoute(): Place | "archive" | null {
  const [hash, set] = useState(location.hash);
  useEffect(() => {
    const changed = () => set(location.hash);
    addEventListener("hashchange", changed);
    return () => removeEventListener("hashchange", changed);
  }, []);
  return hash === ARCHIVE ? "archive" : parse(hash);
}
