// SPDX-License-Identifier: Apache-2.0
// Accessibility and layout checks of a page.

import axe from "axe-core";

/** Return the serious and critical violations that axe-core reports, as texts. */
export async function barriers(page) {
  await page.evaluate(`${axe.source};0`).catch(() => undefined);
  const { violations } = await page.evaluate(() => globalThis.axe.run(document));
  return violations.filter(({ impact }) => impact === "serious" || impact === "critical")
    .map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map((node) => node.html).join(" | ")}`);
}

/** Return the number of elements of a selector that cut off their contents at the side. */
export function countCut(page, selector) {
  return page.locator(selector).evaluateAll((elements) =>
    elements.filter((element) => element.scrollWidth > element.clientWidth + 1).length);
}

/** Return the width by which the page exceeds the screen [px]; 0 or less if it fits. */
export function overflow(page) {
  return page.evaluate(() =>
    document.documentElement.scrollWidth - document.documentElement.clientWidth);
}
