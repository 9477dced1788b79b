// SPDX-License-Identifier: Apache-2.0
// Table of the latest record of a unit, compared with its healthy records.

import { dateTime } from "../format.ts";
import { type FaultEstimate, seconds } from "../messages.ts";
import { rowsOf } from "../quantities.ts";
import { Section } from "./parts.tsx";

export function Quantities({ estimate }: { estimate?: FaultEstimate }) {
  const rows = rowsOf(estimate?.quantities);
  if (!estimate || rows.length === 0) return null;
  return (
    <Section title="Compared with healthy records" id="quantities"
      note={`record that ended ${dateTime(seconds(estimate.window_end))}`}>
      <div class="scroll" tabIndex={0} role="region" aria-label="Table of each quantity">
        <table class="items stacked">
          <thead>
            <tr>
              <th scope="col">quantity</th>
              <th scope="col" class="number">change</th>
              <th scope="col" class="number">90 % interval</th>
              <th scope="col">judgement</th>
            </tr>
          </thead>
          <tbody>
            {rows.map((row) => (
              <tr key={row.name} data-quantity={row.name}>
                <th scope="row">{row.label}</th>
                <td class="number" data-label="change">{row.change || "–"}</td>
                <td class="number" data-label="90 % interval">{row.interval || "–"}</td>
                <td data-label="judgement">
                  {row.isChanged ? <strong>{row.judgement}</strong> : row.judgement}
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </Section>
  );
}
