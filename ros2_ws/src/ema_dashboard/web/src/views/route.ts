// SPDX-License-Identifier: Apache-2.0
// The part of the address behind #, which a reload keeps.

import { useEffect, useState } from "preact/hooks";
import type { Address } from "../protocol.ts";

export function addressOf({ namespace, id }: Address): string {
  return `#/actuator/${encodeURIComponent(namespace)}/${encodeURIComponent(id)}`;
}

export const ARCHIVE = "#/archive";

/** Parts of an actuator's page, by their place in the address. */
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

/** An actuator, the archive, or null for the fleet that runs. */
export function useRoute(): Place | "archive" | null {
  const [hash, set] = useState(location.hash);
  useEffect(() => {
    const changed = () => set(location.hash);
    addEventListener("hashchange", changed);
    return () => removeEventListener("hashchange", changed);
  }, []);
  return hash === ARCHIVE ? "archive" : parse(hash);
}
