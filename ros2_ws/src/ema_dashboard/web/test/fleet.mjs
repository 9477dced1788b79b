// SPDX-License-Identifier: Apache-2.0
// The summary of a random fleet, computed by the dashboard's own code.

import { execFileSync } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { fileURLToPath } from "node:url";

const WRITER = fileURLToPath(new URL("../../../../../tests/web/synthetic_archive.py", import.meta.url));

export function randomFleet() {
  const folder = mkdtempSync(path.join(tmpdir(), "ema-archive-"));
  try {
    return JSON.parse(execFileSync("python", [WRITER, path.join(folder, "hangar_7")]));
  } finally {
    rmSync(folder, { recursive: true });
  }
}
