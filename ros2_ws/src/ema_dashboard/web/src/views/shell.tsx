// SPDX-License-Identifier: Apache-2.0
// Frame of every view: top bar, state of the connection, and playback controls.

import { useEffect, useLayoutEffect } from "preact/hooks";
import { duration } from "../format.ts";
import type { Connection } from "../protocol.ts";
import type { State } from "../state.ts";
import { OneActuator } from "./actuator.tsx";
import { Archive, useSummary } from "./archive.tsx";
import { useApp, useSecond, useStored, useUpdates } from "./hooks.ts";
import { Overview } from "./overview.tsx";
import { Playback } from "./playback.tsx";
import { ARCHIVE, useRoute } from "./route.ts";
import { Diagnostics } from "./system.tsx";

const SILENT_MS = 5000;
const THEMES = ["auto", "light", "dark"];
const dark = matchMedia("(prefers-color-scheme: dark)");

export function Shell({ state }: { state: State }) {
  useUpdates(state);
  const route = useRoute();
  const { send } = useApp();
  const isArchive = route === "archive";
  const actuator = isArchive ? null : route;
  const archive = useSummary(isArchive);
  const name = isArchive ? "archive" : actuator ? `${actuator.namespace}/${actuator.id}` : "";
  useEffect(() => {
    send({ kind: "watch", address: actuator });
    const title = isArchive ? "Archive" : actuator?.id;
    document.title = title ? `${title} · EMA health` : "EMA health";
    scrollTo(0, 0);
  }, [name]);
  const isOff = state.connection.state !== "open";
  return (
    <div class={isOff && state.lastReceived ? "old" : ""}>
      <a class="skip" href="#main" onClick={(event) => {
        event.preventDefault();
        document.getElementById("main")?.focus();
      }}>Skip to content</a>
      <header class="top">
        <a class="brand" href="#/">
          <img src="icon.svg" alt="" width="28" height="28" /> <span>EMA health</span>
        </a>
        {archive.summary && (
          <nav aria-label="Views">
            <a href="#/" aria-current={route === null ? "page" : undefined}>Live</a>
            <a href={ARCHIVE} aria-current={isArchive ? "page" : undefined}>Archive</a>
          </nav>
        )}
        <Connected state={state} />
        <Theme />
      </header>
      <Banner state={state} />
      {state.playback && <Playback playback={state.playback} />}
      {isArchive ? <Archive {...archive} />
        : actuator ? <OneActuator state={state} address={actuator} /> : <Home state={state} />}
    </div>
  );
}

function Home({ state }: { state: State }) {
  if (state.actuators.size === 0) return <NothingYet state={state} />;
  return (
    <>
      <Overview state={state} />
      <div class="below"><Diagnostics state={state} /></div>
    </>
  );
}

function NothingYet({ state }: { state: State }) {
  useSecond();
  if (state.connection.state !== "open" || state.topics === undefined) {
    const isRefused = state.connection.state === "refused";
    return (
      <main id="main" tabIndex={-1} class="middle">
        <h1>{isRefused ? "Not allowed" : "Connecting…"}</h1>
        {!isRefused && <div class="loading" aria-hidden="true"><i /><i /><i /></div>}
        <p class="soft">{isRefused ? state.connection.state === "refused" && state.connection.reason
          : `to the dashboard node at ${location.host}`}</p>
      </main>
    );
  }
  const hasMonitor = state.topics.some((topic) => topic.endsWith("/health"));
  return (
    <>
      <main id="main" tabIndex={-1} class="middle">
        <h1>{hasMonitor ? "No test yet" : "No actuator yet"}</h1>
        <p>
          {hasMonitor
            ? "A monitor is running. The first actuator appears here when its description or its " +
              "first test is received."
            : "The dashboard is running, but there is no monitor and no actuator in its namespace."}
        </p>
        {!hasMonitor && <p class="soft">Start them with <code>ema up</code>, or a monitor with{" "}
          <code>ema up monitor</code> for your own actuator.</p>}
        <p class="soft">{state.topics.length} topics are available.</p>
      </main>
      {state.diagnostics.size > 0 && <div class="below"><Diagnostics state={state} /></div>}
    </>
  );
}

function Connected({ state }: { state: State }) {
  useSecond();
  const { connection } = state;
  const words: Record<Connection["state"], string> = {
    connecting: "connecting…",
    open: isSilent(state) ? "connected, silent" : "live",
    closed: "disconnected",
    refused: "refused",
  };
  const isLive = connection.state === "open" && !isSilent(state);
  return (
    <span class={`connected ${isLive ? "live" : connection.state}`} role="status">
      <i aria-hidden="true" /> {words[connection.state]}
    </span>
  );
}

function isSilent(state: State): boolean {
  return state.lastReceived > 0 && Date.now() - state.lastReceived > SILENT_MS;
}

function Banner({ state }: { state: State }) {
  const { send } = useApp();
  useSecond();
  const { connection } = state;
  if (connection.state === "open") {
    if (!isSilent(state)) return null;
    return (
      <p class="banner warn wide" role="alert">
        <strong>Nothing has been received for{" "}
          {duration((Date.now() - state.lastReceived) / 1000)}.</strong>{" "}
        The dashboard is connected, but no node reports its status. The values shown are from that time.
      </p>
    );
  }
  if (!state.lastReceived) return null;
  const again = (
    <button type="button" onClick={() => send({ kind: "retry" })}>Try now</button>
  );
  const since = duration((Date.now() - state.lostAt) / 1000);
  return (
    <p class="banner error wide" role="alert">
      <strong>
        {connection.state === "refused" ? "The server refuses this page." : `Disconnected for ${since}.`}
      </strong>{" "}
      {connection.state === "refused" ? connection.reason
        : "The values shown are from that time; the page reconnects automatically."} {again}
    </p>
  );
}

function Theme() {
  const [theme, setTheme] = useStored("ema-theme", "auto");
  useLayoutEffect(() => {
    const show = () => {
      const system = dark.matches ? "dark" : "light";
      document.documentElement.dataset.theme = theme === "auto" ? system : theme;
    };
    show();
    dark.addEventListener("change", show);
    return () => dark.removeEventListener("change", show);
  }, [theme]);
  return (
    <label class="theme">
      <span class="unseen">Colours</span>
      <select value={theme} onChange={(event) => setTheme(event.currentTarget.value)}>
        {THEMES.map((name) => <option key={name} value={name}>{name}</option>)}
      </select>
    </label>
  );
}
