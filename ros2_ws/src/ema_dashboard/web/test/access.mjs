// SPDX-License-Identifier: Apache-2.0
// Accessibility and layout checks of a page.

import axe from "axe-core";

/** Return the serious and critical violations that axe-core reports, as texts. */
export async function hindrances(page) {
  await page.evaluate(`${axe.source};0`).catch(() => undefined);
  const { violations } = await page.evaluate(() => globalThis.axe.run(document));
  return violations.filter(({ impact }) => impact === "serious" || impact === "critical")
    .map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map((node) => node.html).join(" | ")}`);
}

/** Return the number of elements of a selector whose contents are wider than they are. */
export function cut(page, selector) {
  return page.locator(selector).evaluateAll((all) =>
    all.filter((element) => element.scrollWidth > element.clientWidth + 1).length);
}

/** Return the width of the page beyond the screen [px]. */
export function overflow(page) {
  return page.evaluate(() =>
    document.documentElement.scrollWidth - document.documentElement.clientWidth);
}
