// SPDX-License-Identifier: Apache-2.0
import { render } from "preact";
import type { FromWorker, ToWorker } from "./protocol.ts";
import { State } from "./state.ts";
import { AppContext } from "./views/hooks.ts";
import { Shell } from "./views/shell.tsx";

// Remove the token from the address, which may be shown or copied: the cookie replaces it.
const address = new URL(location.href);
if (address.searchParams.has("token")) {
  address.searchParams.delete("token");
  history.replaceState(null, "", address);
}

const worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
const send = (message: ToWorker) => worker.postMessage(message);
const state = new State();
worker.onmessage = ({ data }: MessageEvent<FromWorker>) => state.take(data);
addEventListener("online", () => send({ kind: "retry" }));
document.addEventListener("visibilitychange", () => {
  if (!document.hidden) send({ kind: "retry" });
});

const root = document.getElementById("page")!;
root.replaceChildren();
render(<AppContext.Provider value={{ state, send }}><Shell state={state} /></AppContext.Provider>,
  root);
