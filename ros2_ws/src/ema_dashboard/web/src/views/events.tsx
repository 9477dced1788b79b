// SPDX-License-Identifier: Apache-2.0
// Events of a unit, on a time line and as a list.

import { useState } from "preact/hooks";
import { clockTime, dateTime, hours } from "../format.ts";
import { type UnitEvent, seconds } from "../messages.ts";
import type { Address } from "../protocol.ts";
import { Empty, Section } from "./parts.tsx";
import { useBox } from "./hooks.ts";

const MOST_LISTED = 50;

// A sign for each kind, so that kinds can be distinguished without colour.
const KINDS: Record<string, { sign: string; colour: string; word: string }> = {
  fault: { sign: "▲", colour: "error", word: "fault" },
  departure: { sign: "△", colour: "warn", word: "departure" },
  repair: { sign: "✚", colour: "ok", word: "repair" },
  step: { sign: "◆", colour: "warn", word: "step" },
  outlier: { sign: "○", colour: "warn", word: "outlier" },
  calibration: { sign: "■", colour: "model", word: "calibration" },
  gap: { sign: "▬", colour: "stale", word: "gap" },
  restart: { sign: "↻", colour: "data", word: "restart" },
  service_hours: { sign: "◷", colour: "data", word: "service hours" },
  history: { sign: "▤", colour: "stale", word: "history" },
  note: { sign: "✎", colour: "data", word: "note" },
};
const OTHER = { sign: "●", colour: "stale", word: "other" };

const kindOf = (event: UnitEvent) => KINDS[event.kind] ?? OTHER;

export function Events({ events, now, address }: {
  events?: UnitEvent[]; now: number; address: Address;
}) {
  const count = events?.length ?? 0;
  const [open, setOpen] = useState("");
  const noted = new Set(events?.filter(({ kind }) => kind === "note").map(timeOf));
  return (
    <Section title="Events" id="events" note={count > 0 && `${count} stored`}>
      {!events ? <Empty>Loading the history…</Empty> : count === 0 ? (
        <Empty>No events since the first test of this unit.</Empty>
      ) : (
        <>
          <TimeLine events={events} now={now} />
          <ol class="events" tabIndex={0} aria-label="Events, the latest first">
            {events.slice(-MOST_LISTED).reverse().map((event) => {
              const kind = kindOf(event);
              const key = `${timeOf(event)} ${event.kind} ${event.text}`;
              return (
                <li key={key}>
                  <span class="event-sign" style={{ color: `var(--${kind.colour})` }}
                    aria-hidden="true">{kind.sign}</span>
                  <strong>{kind.word}</strong>
                  <span class="event-text">{event.text}</span>
                  <span class="soft event-time">
                    {Number.isFinite(event.flight_hours) && `${hours(event.flight_hours)} h · `}
                    {dateTime(seconds(event.stamp))}
                    {event.kind !== "note" && (
                      <>
                        {noted.has(timeOf(event)) && " · ✓ noted"}{" "}
                        <button type="button" aria-expanded={open === key}
                          onClick={() => setOpen(open === key ? "" : key)}>Note</button>
                      </>
                    )}
                  </span>
                  {open === key && (
                    <NoteForm event={event} address={address} close={() => setOpen("")} />
                  )}
                </li>
              );
            })}
          </ol>
          {count > MOST_LISTED && <p class="soft">{count - MOST_LISTED} older events not listed</p>}
        </>
      )}
    </Section>
  );
}

const timeOf = ({ stamp }: UnitEvent) => `${stamp.sec}.${stamp.nanosec}`;

/** Acknowledges an event: the monitor stores name and note, and publishes them as an event. */
function NoteForm({ event, address, close }: { event: UnitEvent; address: Address; close: () => void }) {
  const [refusal, setRefusal] = useState("");
  const send = async (submitted: SubmitEvent) => {
    submitted.preventDefault();
    const typed = new FormData(submitted.currentTarget as HTMLFormElement);
    const { sec, nanosec } = event.stamp;
    const content = { namespace: address.namespace, actuator_id: address.id, sec, nanosec };
    try {
      const answer = await fetch("note", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ ...content, ...Object.fromEntries(typed) }),
      });
      if (answer.ok) close();
      else setRefusal(await answer.text());
    } catch {
      setRefusal("The dashboard does not respond: the note was not stored.");
    }
  };
  return (
    <form class="note" onSubmit={send}>
      <input name="person" required maxLength={60} placeholder="Name" aria-label="Name" />
      <input name="text" required maxLength={500} placeholder="Note" aria-label="Note" />
      <button type="submit">Save</button>
      {refusal && <span role="alert">{refusal}</span>}
    </form>
  );
}

function TimeLine({ events, now }: { events: UnitEvent[]; now: number }) {
  const [ref, width] = useBox<HTMLDivElement>();
  const times = events.map((event) => seconds(event.stamp));
  const first = Math.min(...times);
  const last = Math.max(now, ...times);
  const span = Math.max(last - first, 1);
  const at = (time: number) => 14 + ((time - first) / span) * Math.max(width - 28, 1);
  const isShort = span < 86_400;
  const text = (time: number) => (isShort ? clockTime(time) : dateTime(time).slice(0, 16));
  return (
    <div class="timeline" ref={ref} role="img"
      aria-label={`${events.length} events from ${dateTime(first)} on`}>
      {width > 0 && (
        <svg width={width} height="64">
          <line x1="14" x2={width - 14} y1="34" y2="34" class="axis" />
          {events.map((event, i) => {
            const kind = kindOf(event);
            return (
              <text key={i} x={at(times[i]!)} y="29" text-anchor="middle" class="mark"
                style={{ fill: `var(--${kind.colour})` }}>
                <title>{`${kind.word}: ${event.text}`}</title>
                {kind.sign}
              </text>
            );
          })}
          <text x="14" y="55" class="tick">{text(first)}</text>
          <text x={width - 14} y="55" text-anchor="end" class="tick">{text(last)}</text>
        </svg>
      )}
    </div>
  );
}
