// SPDX-License-Identifier: Apache-2.0
// Overview of all actuators, worst first.

import { memo } from "preact/compat";
import { useMemo } from "preact/hooks";
import { labelOf } from "../faults.ts";
import { fixed } from "../format.ts";
import { isJoint, isLearning } from "../joints.ts";
import { LEARNING, LEVELS } from "../levels.ts";
import { ACTIONS, DEPARTED, seconds } from "../messages.ts";
import type { Actuator, State } from "../state.ts";
import { useApp, useStored } from "./hooks.ts";
import { Joints } from "./joints.tsx";
import { Life, RemoveBefore, why } from "./life.tsx";
import { Badge, Bar, Shape, Since, classOf, levelOf, silence } from "./parts.tsx";
import { addressOf } from "./route.ts";

interface Column {
  name: string;
  title: string;
  unit?: string;
  sortKey: (actuator: Actuator) => number | string; // sorted in ascending order
}

const unknownLast = (value?: number) =>
  value === undefined || Number.isNaN(value) ? Infinity : value;

const lifeOf = (actuator: Actuator, quantile: "hours_05" | "hours_50") => {
  const life = actuator.health?.rul;
  return life?.known ? unknownLast(life[quantile]) : Infinity;
};

const COLUMNS: Column[] = [
  { name: "level", title: "Level", sortKey: (actuator) => levelOf(actuator).rank },
  { name: "actuator", title: "Actuator", sortKey: (actuator) => actuator.id },
  { name: "health", title: "Health index", sortKey: (actuator) => unknownLast(actuator.health?.health_index) },
  { name: "cause", title: "Worst fault or requirement", sortKey: (actuator) => dominant(actuator) || "~" },
  { name: "life", title: "Remaining life", unit: "median, 5 – 95 %",
    sortKey: (actuator) => lifeOf(actuator, "hours_50") },
  { name: "remove", title: "Remove",
    sortKey: (actuator) => (actuator.health?.level === 2 ? -1 : lifeOf(actuator, "hours_05")) },
  { name: "test", title: "Last test", unit: "ago",
    sortKey: (actuator) => -(actuator.health ? seconds(actuator.health.header.stamp) : 0) },
  { name: "advice", title: "Advice", sortKey: (actuator) => -(actuator.advice?.action ?? -1) },
];

function dominant(actuator: Actuator): string {
  const name = actuator.health?.dominant_fault;
  return name ? labelOf(name) : "";
}

/** Order of actuators, worst first: by level, remaining life and health index. */
export function byWorst(a: Actuator, b: Actuator): number {
  return levelOf(a).rank - levelOf(b).rank ||
    difference(lifeOf(a, "hours_05"), lifeOf(b, "hours_05")) ||
    difference(unknownLast(a.health?.health_index), unknownLast(b.health?.health_index)) ||
    a.key.localeCompare(b.key);
}

function difference(a: number, b: number): number {
  return a === b ? 0 : a < b ? -1 : 1;
}

function sorted(actuators: Actuator[], by: string): Actuator[] {
  const isDown = by.startsWith("-");
  const column = COLUMNS.find(({ name }) => name === by.replace("-", ""));
  if (!column || by === "level") return actuators.sort(byWorst);
  const compare = (left: Actuator, right: Actuator) => {
    const [a, b] = [column.sortKey(left), column.sortKey(right)];
    return typeof a === "string" ? a.localeCompare(String(b)) : difference(a, Number(b));
  };
  return actuators.sort((a, b) =>
    (isDown ? -1 : 1) * compare(a, b) || byWorst(a, b));
}

function matches(actuator: Actuator, words: string): boolean {
  const text = `${actuator.id} ${actuator.serial} ${actuator.namespace} ` +
    `${actuator.description?.model ?? ""} ${dominant(actuator)} ${levelOf(actuator).word}`;
  return words.toLowerCase().split(/\s+/).every((word) => text.toLowerCase().includes(word));
}

const CHOICES = [LEVELS[2]!, LEVELS[1]!, LEVELS[3]!, LEARNING, LEVELS[0]!];

export function Overview({ state }: { state: State }) {
  const [by, setBy] = useStored("ema-sort", "level");
  const [words, setWords] = useStored("ema-filter", "");
  const [shown, setShown] = useStored("ema-levels", "");
  const [view, setView] = useStored("ema-joints", "grid");
  const all = [...state.actuators.values()];
  const namespaces = useMemo(() => new Set(all.map((actuator) => actuator.namespace)), [all.length]);
  const chosen = all.filter((actuator) =>
    matches(actuator, words) && (!shown || nameOf(actuator) === shown));
  const hasJoints = all.some(isJoint);
  const joints = view === "grid" ? chosen.filter(isJoint) : [];
  const rows = sorted(view === "grid" ? chosen.filter((actuator) => !isJoint(actuator)) : chosen, by);
  // Without costs, there is no advice.
  const isAdvised = all.some(({ advice }) => advice !== undefined && advice.action > 0);
  const columns = COLUMNS.filter(({ name }) => name !== "advice" || isAdvised);
  const count = (name: string) => all.filter((actuator) => nameOf(actuator) === name).length;

  return (
    <main id="main" tabIndex={-1}>
      <h1 class="view-title">
        Overview <span class="soft">{numbersOf(all)}</span>
      </h1>
      <div class="overview-tools">
        <div class="chips" role="group" aria-label="Show one level only">
          {CHOICES.filter((level) => hasJoints || level !== LEARNING).map((level) => (
            <button type="button" key={level.name} class={`chip ${level.name}`}
              aria-pressed={shown === level.name}
              onClick={() => setShown(shown === level.name ? "" : level.name)}>
              <Shape level={level} size={20} />
              <strong>{count(level.name)}</strong> {level.word}
            </button>
          ))}
        </div>
        <label class="filter">
          <span>Filter</span>
          <input type="search" value={words} placeholder="name, serial number, fault"
            onInput={(event) => setWords(event.currentTarget.value)} />
        </label>
        {hasJoints && (
          <div class="choice" role="group" aria-label="Joints">
            {["grid", "table"].map((name) => (
              <button type="button" key={name} aria-pressed={view === name}
                onClick={() => setView(name)}>{name}</button>
            ))}
          </div>
        )}
        {rows.length > 0 && (
          <label class="sort-choice">
            <span>Sort by</span>
            <select value={by} onChange={(event) => setBy(event.currentTarget.value)}>
              {columns.map(({ name, title }) => (
                <option key={name} value={name}>
                  {name === "level" ? "Level, worst first" : title}
                </option>
              ))}
            </select>
          </label>
        )}
      </div>
      {joints.length > 0 && (
        <Joints state={state} joints={joints} hasNamespace={namespaces.size > 1} />
      )}
      {chosen.length === 0 && (
        <p class="empty">
          None of {all.length} actuators matches.{" "}
          <button type="button" class="link" onClick={() => { setWords(""); setShown(""); }}>
            Show all
          </button>
        </p>
      )}
      {rows.length > 0 && (
        <table class={`overview ${isAdvised ? "advised" : ""}`} role="table">
          <caption class="unseen">Actuators, {rows.length} of {all.length}</caption>
          <thead role="rowgroup">
            <tr role="row">
              {columns.map((column) => <Head key={column.name} column={column} by={by}
                onSort={setBy} />)}
            </tr>
          </thead>
          <tbody role="rowgroup">
            {rows.map((item) => (
              <Row key={item.key} actuator={item} hasNamespace={namespaces.size > 1}
                isAdvised={isAdvised} />
            ))}
          </tbody>
        </table>
      )}
    </main>
  );
}

/** Numbers of joints and of actuators with a modelled drive, as text. */
function numbersOf(all: Actuator[]): string {
  const joints = all.filter(isJoint).length;
  const others = all.length - joints;
  return [
    joints && `${joints} ${joints === 1 ? "joint" : "joints"}`,
    (others || !joints) && `${others} ${others === 1 ? "actuator" : "actuators"}`,
  ].filter(Boolean).join(", ");
}

function nameOf(actuator: Actuator): string {
  return levelOf(actuator).name;
}

function Head({ column, by, onSort }: {
  column: Column; by: string; onSort: (by: string) => void;
}) {
  const { name, title, unit } = column;
  const direction = by === name ? "ascending" : by === `-${name}` ? "descending" : "none";
  const isDefault = name === "level";
  return (
    <th scope="col" role="columnheader" class={`c-${name}`} aria-sort={direction}>
      <button type="button"
        onClick={() => onSort(direction === "ascending" && !isDefault ? `-${name}` : name)}>
        {title}
        <span class="arrow" aria-hidden="true">
          {direction === "ascending" ? "▲" : direction === "descending" ? "▼" : ""}
        </span>
      </button>
      {unit && <small>{unit}</small>}
    </th>
  );
}

const Row = memo(({ actuator, hasNamespace, isAdvised }: {
  actuator: Actuator; hasNamespace: boolean; isAdvised: boolean;
}) => {
  const { health, advice } = actuator;
  const level = levelOf(actuator);
  const { send } = useApp();
  const open = () => {
    location.hash = addressOf(actuator);
    send({ kind: "watch", address: actuator });
  };
  return (
    <tr role="row" class={classOf(level)} data-actuator={actuator.key} onClick={open}>
      <td role="cell" class="c-level"><Badge level={level} /></td>
      <th scope="row" role="rowheader" class="c-actuator">
        <a href={addressOf(actuator)}>{actuator.id}</a>
        <small>
          {hasNamespace && `${actuator.namespace} · `}{actuator.serial || "no serial number"}
        </small>
      </th>
      <td role="cell" class="c-health" data-label="Health index">
        {health && Number.isFinite(health.health_index) ? (
          <span class="with-bar">
            <Bar share={health.health_index} level={level} />
            <strong>{fixed(health.health_index, 2)}</strong>
          </span>
        ) : "–"}
      </td>
      <td role="cell" class="c-cause">
        {!health?.cause && dominant(actuator) && <strong>{dominant(actuator)}</strong>}
        <small>
          {silence(actuator)}{health ? why(health) : waiting(actuator)}
        </small>
      </td>
      <td role="cell" class="c-life" data-label="Remaining life">
        {health ? <Life life={health.rul} /> : "–"}
      </td>
      <td role="cell" class="c-remove" data-label="Remove">
        {health ? <RemoveBefore health={health} /> : "–"}
      </td>
      <td role="cell" class="c-test" data-label="Last test"><Since health={health} suffix=" ago" /></td>
      {isAdvised && (
        <td role="cell" class="c-advice" data-label="Advice">
          {advice ? <span title={advice.reason}>{ACTIONS[advice.action]}</span> : "–"}
        </td>
      )}
    </tr>
  );
});

function waiting(actuator: Actuator): string {
  if (actuator.estimate && !actuator.estimate.valid) {
    if (isLearning(actuator)) return actuator.estimate.reason;
    const is = actuator.estimate.verdict === DEPARTED ? "" : "refused: ";
    return `test ${is}${actuator.estimate.reason}`;
  }
  return "waiting for the first test";
}
