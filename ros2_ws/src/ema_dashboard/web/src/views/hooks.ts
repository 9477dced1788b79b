// SPDX-License-Identifier: Apache-2.0
import { createContext } from "preact";
import { useContext, useEffect, useReducer, useRef, useState } from "preact/hooks";
import type { State } from "../state.ts";
import type { ToWorker } from "../protocol.ts";

export interface App {
  state: State;
  send: (message: ToWorker) => void;
}

export const AppContext = createContext<App>(undefined as unknown as App);

export function useApp(): App {
  return useContext(AppContext);
}

/** Render the component again when the state has changed. */
export function useUpdates(state: State): void {
  const [, update] = useReducer((count: number) => count + 1, 0);
  useEffect(() => state.subscribe(() => update(undefined as never)), [state]);
}

const ticking = new Set<() => void>();
setInterval(() => ticking.forEach((update) => update()), 1000);

/** Render the component again every second. */
export function useSecond(): void {
  const [, update] = useReducer((count: number) => count + 1, 0);
  useEffect(() => {
    const tick = () => update(undefined as never);
    ticking.add(tick);
    return () => void ticking.delete(tick);
  }, []);
}

/** A setting in local storage, which survives a reload. */
export function useStored(name: string, initial: string): [string, (value: string) => void] {
  const [value, set] = useState(() => localStorage.getItem(name) ?? initial);
  return [value, (next) => {
    localStorage.setItem(name, next);
    set(next);
  }];
}

/** The current theme, "light" or "dark", with whose colours plots are drawn. */
export function useTheme(): string {
  const shown = () => document.documentElement.dataset.theme ?? "light";
  const [theme, set] = useState(shown);
  useEffect(() => {
    const observer = new MutationObserver(() => set(shown()));
    observer.observe(document.documentElement, { attributeFilter: ["data-theme"] });
    set(shown());
    return () => observer.disconnect();
  }, []);
  return theme;
}

/** Return a reference for an element, its width [px], and whether it is visible on the screen. */
export function useBox<T extends HTMLElement>(): [{ current: T | null }, number, () => boolean] {
  const ref = useRef<T>(null);
  const [width, setWidth] = useState(0);
  const isSeen = useRef(true);
  useEffect(() => {
    const element = ref.current!;
    const resized = new ResizeObserver(() => setWidth(Math.floor(element.clientWidth)));
    const seen = new IntersectionObserver((entries) => {
      isSeen.current = entries.at(-1)!.isIntersecting;
    });
    resized.observe(element);
    seen.observe(element);
    setWidth(Math.floor(element.clientWidth));
    return () => {
      resized.disconnect();
      seen.disconnect();
    };
  }, []);
  return [ref, width, () => isSeen.current];
}
