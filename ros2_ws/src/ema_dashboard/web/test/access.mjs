// SPDX-License-Identifier: Apache-2.0
// What keeps people from a page.

import axe from "axe-core";

/** What axe-core finds serious or critical. */
export async function hindrances(page) {
  await page.evaluate(`${axe.source};0`).catch(() => undefined);
  const { violations } = await page.evaluate(() => globalThis.axe.run(document));
  return violations.filter(({ impact }) => impact === "serious" || impact === "critical")
    .map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map((node) => node.html).join(" | ")}`);
}

/** How many elements of a kind have contents that are wider than they are. */
export function cut(page, selector) {
  return page.locator(selector).evaluateAll((all) =>
    all.filter((one) => one.scrollWidth > one.clientWidth + 1).length);
}

/** By how much the page is wider than the screen [px]. */
export function overflow(page) {
  return page.evaluate(() =>
    document.documentElement.scrollWidth - document.documentElement.clientWidth);
}
