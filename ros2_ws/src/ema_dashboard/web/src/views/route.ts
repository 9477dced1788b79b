// The part of the address behind #, which a reload keeps.

import { useEffect, useState } from "preact/hooks";
import type { Address } from "../protocol.ts";

export function addressOf({ namespace, id }: Address): string {
  return `#/actuator/${encodeURIComponent(namespace)}/${encodeURIComponent(id)}`;
}

export const ARCHIVE = "#/archive";

export function parse(hash: string): Address | null {
  const [, name, namespace, id] = hash.replace(/^#/, "").split("/");
  if (name !== "actuator" || namespace === undefined || id === undefined) return null;
  try {
    return { namespace: decodeURIComponent(namespace), id: decodeURIComponent(id) };
  } catch {
    return null;
  }
}

/** An actuator, the archive, or null for the fleet that runs. */
export function useRoute(): Address | "archive" | null {
  const [hash, set] = useState(location.hash);
  useEffect(() => {
    const changed = () => set(location.hash);
    addEventListener("hashchange", changed);
    return () => removeEventListener("hashchange", changed);
  }, []);
  return hash === ARCHIVE ? "archive" : parse(hash);
}
