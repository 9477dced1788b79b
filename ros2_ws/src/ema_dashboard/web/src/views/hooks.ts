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

/** Draw again when the state has changed. */
export function useUpdates(state: State): void {
  const [, update] = useReducer((count: number) => count + 1, 0);
  useEffect(() => state.subscribe(() => update(undefined as never)), [state]);
}

const ticking = new Set<() => void>();
setInterval(() => ticking.forEach((one) => one()), 1000);

/** Draw again each second. */
export function useSecond(): void {
  const [, update] = useReducer((count: number) => count + 1, 0);
  useEffect(() => {
    const one = () => update(undefined as never);
    ticking.add(one);
    return () => void ticking.delete(one);
  }, []);
}

/** A choice that a reload keeps. */
export function useStored(name: string, initial: string): [string, (value: string) => void] {
  const [value, set] = useState(() => localStorage.getItem(name) ?? initial);
  return [value, (next) => {
    localStorage.setItem(name, next);
    set(next);
  }];
}

/** Which colours are shown now; plots are drawn with them. */
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

/** Width of an element, and whether it is on the screen. */
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
