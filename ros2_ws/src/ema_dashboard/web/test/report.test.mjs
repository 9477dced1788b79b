// SPDX-License-Identifier: Apache-2.0
// The page of `ema report` on a phone.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { overflow } from "./access.mjs";
import { launchBrowser } from "./stage.mjs";

const SAMPLE = fileURLToPath(new URL("../../../../../bags/faulty_flap.mcap", import.meta.url));

test("on a phone, a report has complete captions and legible figures, and scrolls only vertically", async () => {
  const report = path.join(mkdtempSync(path.join(tmpdir(), "report-")), "report.html");
  execFileSync("ema", ["report", SAMPLE, "-o", report]);
  const browser = await launchBrowser();
  try {
    const page = await browser.newPage({ viewport: { width: 390, height: 844 } });
    await page.goto(`file://${report}`);
    assert.ok((await overflow(page)) <= 0);
    const rightEdges = await page.locator("caption, figcaption").evaluateAll((elements) =>
      elements.map((element) => element.getBoundingClientRect().right));
    assert.ok(rightEdges.length > 4 && Math.max(...rightEdges) <= 390, String(rightEdges));
    const heights = await page.locator("svg text").evaluateAll((elements) =>
      elements.map((element) => element.getBoundingClientRect().height));
    assert.ok(Math.min(...heights) >= 9, String(Math.min(...heights)));
  } finally {
    await browser.close();
  }
});
