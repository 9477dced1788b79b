// SPDX-License-Identifier: Apache-2.0
// The baseline of a joint: its healthy records, and a form for changes by a person.

import { useState } from "preact/hooks";
import { dateTime, fixed, significant } from "../format.ts";
import { countsText, detectableText, inPercent } from "../joints.ts";
import { type ActuatorDescription, type BaselineStatus, LEARNING_STATE, seconds } from "../messages.ts";
import type { Address } from "../protocol.ts";
import { useApp } from "./hooks.ts";
import { Figure, Section } from "./parts.tsx";

/** Progress of learning, with the most effective advice to detect smaller changes. */
export function Progress({ baseline, isAdvised = false }: {
  baseline: BaselineStatus; isAdvised?: boolean;
}) {
  const detectable = detectableText(baseline);
  const share = baseline.records / baseline.records_needed;
  return (
    <div class="learning">
      {baseline.records_needed > 0 && (
        <span class="bar learning" aria-hidden="true">
          <span style={{ width: `${100 * Math.min(share, 1)}%` }} />
        </span>
      )}
      <p><strong>{countsText(baseline)}</strong></p>
      {detectable && <p>{detectable}</p>}
      {baseline.reason && <p class="reason">{baseline.reason}</p>}
      {isAdvised && baseline.advice[0] && <p class="soft">{baseline.advice[0]}</p>}
      {!baseline.reason && !baseline.records_needed && (
        <p class="soft">A person accepts the baseline.</p>
      )}
    </div>
  );
}

interface Change {
  name: "accept" | "extend" | "reset";
  title: string;
  effect: string;
}

const ACCEPT: Change = {
  name: "accept", title: "Accept",
  effect: "You confirm that the joint was healthy in these records. Later records are compared " +
    "with them.",
};
const EXTEND: Change = {
  name: "extend", title: "Extend",
  effect: "Records since the acceptance that agree with the baseline are added to it.",
};
const RESET: Change = {
  name: "reset", title: "Reset",
  effect: "The baseline and its records are discarded. The joint learns again, without a level.",
};

export function Baseline({ baseline, description, address }: {
  baseline: BaselineStatus; description?: ActuatorDescription; address: Address;
}) {
  const { state } = useApp();
  const [open, setOpen] = useState<Change>();
  const isLearning = baseline.state === LEARNING_STATE;
  const speedUnit = description && description.lead > 0 ? "m/s" : "rad/s";
  const { slowest, fastest, forward_share: forward } = baseline;
  return (
    <Section title="Baseline" id="baseline" note={!isLearning && (
      <>accepted by {baseline.author}, {dateTime(seconds(baseline.accepted))}</>
    )}>
      <dl class="figures small">
        <Figure label="state">{isLearning ? "learning" : "accepted"}</Figure>
        <Figure label="healthy records">
          {countsText(baseline)}
        </Figure>
        <Figure label="usual speeds" note={Number.isFinite(forward) &&
          `${fixed(100 * forward, 0)} % of the motion is forward`}>
          {Number.isFinite(slowest)
            ? `${significant(slowest, 2)} to ${significant(fastest, 2)} ${speedUnit}` : "–"}
        </Figure>
        <Figure label="smallest detectable change of friction" note={
          inPercent(baseline.detectable_other_day) &&
            `${inPercent(baseline.detectable_other_day)} on another day`}>
          {inPercent(baseline.detectable_same_day) || "–"}
        </Figure>
        {baseline.calibration_id && (
          <Figure label="calibration">{baseline.calibration_id}</Figure>
        )}
      </dl>
      {baseline.advice.length > 0 && (
        <ul class="advice-list" aria-label="How to detect smaller changes">
          {baseline.advice.map((sentence) => <li key={sentence}>{sentence}</li>)}
        </ul>
      )}
      {/* During a playback, no monitor can change the baseline. */}
      {!state.playback && (
        <div class="changes">
          {[isLearning ? ACCEPT : EXTEND, RESET].map((change) => (
            <button type="button" key={change.name} aria-expanded={open === change}
              class={change === ACCEPT ? "main" : ""}
              onClick={() => setOpen(open === change ? undefined : change)}>{change.title}</button>
          ))}
          {open && (
            <ChangeForm key={open.name} change={open} address={address} close={() => setOpen(undefined)}
              canForce={open !== RESET && Number.isFinite(baseline.detectable_same_day)} />
          )}
        </div>
      )}
    </Section>
  );
}

/**
  * Requests a change of the baseline in a person's name. A change cannot be forced without enough
  * records for a fit.
 */
function ChangeForm({ change, address, close, canForce }: {
  change: Change; address: Address; close: () => void; canForce: boolean;
}) {
  const [refusal, setRefusal] = useState("");
  const [isSent, setSent] = useState(false);
  const send = async (submitted: SubmitEvent) => {
    submitted.preventDefault();
    const typed = new FormData(submitted.currentTarget as HTMLFormElement);
    const content = {
      namespace: address.namespace, actuator_id: address.id, change: change.name,
      person: typed.get("person"), note: typed.get("note"), force: typed.has("force"),
    };
    setSent(true);
    try {
      const answer = await fetch("baseline", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify(content),
      });
      if (answer.ok) return close();
      setRefusal(await answer.text());
    } catch {
      setRefusal("The dashboard does not respond: the baseline is unchanged.");
    }
    setSent(false);
  };
  return (
    <form class="change" onSubmit={send}>
      <p>{change.effect}</p>
      <input name="person" required maxLength={60} placeholder="Name" aria-label="Name" />
      <input name="note" maxLength={500} placeholder="Note, such as a repair" aria-label="Note" />
      {refusal && (
        <>
          <p role="alert" class="banner error"><strong>Refused:</strong> {refusal}</p>
          {canForce && (
            <label><input type="checkbox" name="force" /> {change.title} anyway</label>
          )}
        </>
      )}
      <button type="submit" disabled={isSent}>
        {isSent ? "Waiting for the monitor…" : `${change.title} the baseline`}
      </button>
      <button type="button" onClick={close}>Cancel</button>
    </form>
  );
}
