// What keeps people from a page.

import axe from "axe-core";

/** What axe-core finds serious or critical. */
export async function hindrances(page) {
  await page.evaluate(`${axe.source};0`).catch(() => undefined);
  const { violations } = await page.evaluate(() => globalThis.axe.run(document));
  return violations.filter(({ impact }) => impact === "serious" || impact === "critical")
    .map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map((node) => node.html).join(" | ")}`);
}

/** By how much the page is wider than the screen [px]. */
export function overflow(page) {
  return page.evaluate(() =>
    document.documentElement.scrollWidth - document.documentElement.clientWidth);
}
