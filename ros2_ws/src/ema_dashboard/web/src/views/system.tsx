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

export function Diagnostics({ state, address }: { state: State; address?: Address }) {
  useSecond();
  const all = [...state.diagnostics.values()];
  const chosen = address === undefined ? all : all.filter((status) => isOf(address, status));
  const shown = chosen.sort((a, b) => rank(a) - rank(b) ||
    a.name.localeCompare(b.name));
  const rows = address === undefined ? shown.filter((status) => status.level > 0 || isOfNode(status)) : shown;
  const isMany = new Set(all.map(namespaceOf)).size > 1;
  const list = (statuses: Diagnostic[]) => (
    <ul class="diagnostics">
      {statuses.map((status) => (
        <li key={status.name}>
          <Badge level={LEVELS[isSilent(status) ? 3 : status.level] ?? UNKNOWN} />
          <strong title={status.name}>{labelOf(status, address, isMany)}</strong>
          <span>
            {status.message}
            {isSilent(status) &&
              <span class="soft"> silent for {duration((Date.now() - status.received) / 1000)}</span>}
          </span>
          {address !== undefined && status.values.length > 0 && (
            <details>
              <summary>{status.values.length} {status.values.length === 1 ? "value" : "values"}</summary>
              <dl class="values">
                {status.values.map(({ key, value }) => {
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
  const quiet = rows.filter((status) => status.level === 0 && !isSilent(status));
  return (
    <Section title={address === undefined ? "System" : "Diagnostics"} id="diagnostics">
      {rows.length === 0 && <Empty>No status has been received.</Empty>}
      {list(rows.filter((status) => !quiet.includes(status)))}
      {quiet.length > 0 && (
        <details class="quiet"><summary>{quiet.length} OK</summary>{list(quiet)}</details>
      )}
    </Section>
  );
}

/** Label of a status: its task, without the actuator's name on its page, else with the node. */
function labelOf({ name }: Diagnostic, address: Address | undefined, isMany: boolean): string {
  const [, node = "", task = name] = /^(.*?): (.*)$/.exec(name) ?? [];
  if (address !== undefined) return task.replace(`${address.id} `, "");
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

function isSilent(status: Diagnostic): boolean {
  return Date.now() - status.received > SILENT_MS;
}

function rank(status: Diagnostic): number {
  return (LEVELS[isSilent(status) ? 3 : status.level] ?? UNKNOWN).rank;
}
