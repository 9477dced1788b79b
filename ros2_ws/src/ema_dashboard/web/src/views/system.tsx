// SPDX-License-Identifier: Apache-2.0
// Status of the nodes, from /diagnostics.

import { duration, significant } from "../format.ts";
import { LEVELS, UNKNOWN } from "../levels.ts";
import type { Address } from "../protocol.ts";
import { type Diagnostic, type State, isOf, namespaceOf } from "../state.ts";
import { useSecond } from "./hooks.ts";
import { Badge, Empty, Section } from "./parts.tsx";

const SILENT_MS = 5000;

/** Labels of diagnostic tasks whose names are ROS terms. */
const TASKS: Record<string, string> = {
  lifecycle: "state", peers: "other nodes", input: "telemetry", identification: "analysis of tests",
  dashboard: "web page",
};

export function Diagnostics({ state, of }: { state: State; of?: Address }) {
  useSecond();
  const all = [...state.diagnostics.values()];
  const chosen = of === undefined ? all : all.filter((one) => isOf(of, one));
  const shown = chosen.sort((one, other) => rank(one) - rank(other) ||
    one.name.localeCompare(other.name));
  const rows = of === undefined ? shown.filter((one) => one.level > 0 || isOfNode(one)) : shown;
  const isMany = new Set(all.map(namespaceOf)).size > 1;
  const list = (some: Diagnostic[]) => (
    <ul class="diagnostics">
      {some.map((one) => (
        <li key={one.name}>
          <Badge level={LEVELS[isSilent(one) ? 3 : one.level] ?? UNKNOWN} />
          <strong title={one.name}>{labelOf(one, of, isMany)}</strong>
          <span>
            {one.message}
            {isSilent(one) &&
              <span class="soft"> silent for {duration((Date.now() - one.received) / 1000)}</span>}
          </span>
          {of !== undefined && one.values.length > 0 && (
            <details>
              <summary>{one.values.length} {one.values.length === 1 ? "figure" : "figures"}</summary>
              <dl class="values">
                {one.values.map(({ key, value }) => {
                  const [, name, unit = ""] = /^(.*?)(?: \[(.*)\])?$/.exec(key)!;
                  return <div key={key}><dt>{name}</dt><dd>{figure(value)} {unit}</dd></div>;
                })}
              </dl>
            </details>
          )}
        </li>
      ))}
    </ul>
  );
  const quiet = rows.filter((one) => one.level === 0 && !isSilent(one));
  return (
    <Section title={of === undefined ? "System" : "Diagnostics"} id="diagnostics">
      {rows.length === 0 && <Empty>No status has been received.</Empty>}
      {list(rows.filter((one) => !quiet.includes(one)))}
      {quiet.length > 0 && (
        <details class="quiet"><summary>{quiet.length} OK</summary>{list(quiet)}</details>
      )}
    </Section>
  );
}

/** Label of a status: its task, without the actuator's name on its page, else with the node. */
function labelOf({ name }: Diagnostic, of: Address | undefined, isMany: boolean): string {
  const [, node = "", task = name] = /^(.*?): (.*)$/.exec(name) ?? [];
  if (of !== undefined) return task.replace(`${of.id} `, "");
  return `${isMany ? node : node.replace(/^.*\//, "")}: ${TASKS[task] ?? task}`;
}

/** A value of a status as text; numbers other than integers are rounded to four digits. */
function figure(value: string): string {
  if (value === "nan") return "unknown";
  return value.includes(".") && Number.isFinite(Number(value))
    ? significant(Number(value), 4) : value;
}

/** Whether a status concerns a node as a whole, rather than one actuator. */
function isOfNode({ name }: Diagnostic): boolean {
  return /: \S+$/.test(name);
}

function isSilent(one: Diagnostic): boolean {
  return Date.now() - one.received > SILENT_MS;
}

function rank(one: Diagnostic): number {
  return (LEVELS[isSilent(one) ? 3 : one.level] ?? UNKNOWN).rank;
}
