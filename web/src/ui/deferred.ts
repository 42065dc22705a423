/** Parts of the page whose code is loaded when they are shown first, or earlier, while nothing else is to be done. */
import { type ComponentType, createElement, lazy, useState } from "react";

type Load<P> = () => Promise<{ default: ComponentType<P> }>;

/** Waits between the tries to load a part: about half a minute, as long as a server takes to come back. */
const WAITS_MS = [500, 1000, 2000, 4000, 5000, 5000, 5000, 5000];

const loads: (() => Promise<unknown>)[] = [];

/** What makes the parts whose loading failed be loaded again. */
const renewals: (() => void)[] = [];

/**
 * A part that is loaded later. A server that is away for a while is asked again; only then its boundary gets the error, and the
 * part fails until `renewFailedParts`. It is `preloaded` with the others unless it is too large.
 */
export function deferred<P extends object>(load: Load<P>, { preloaded = true } = {}): ComponentType<P> {
  let hasFailed = false;
  const begin = () =>
    lazy(() =>
      loadWithRetries(load).catch((error: unknown) => {
        hasFailed = true;
        throw error;
      }),
    );
  // React keeps the outcome of a lazy component for good, also a failure.
  let part = begin();
  if (preloaded) loads.push(load);
  renewals.push(() => {
    if (!hasFailed) return;
    hasFailed = false;
    part = begin();
  });
  return function Deferred(props: P) {
    const [Part] = useState(() => part);
    return createElement(Part as unknown as ComponentType<P>, props);
  };
}

/** Something else to be loaded with the parts. */
export function preload(load: () => Promise<unknown>): void {
  loads.push(load);
}

/** Load parts that failed anew when they are shown again. */
export function renewFailedParts(): void {
  for (const renew of renewals) renew();
}

export async function loadWithRetries<T>(load: () => Promise<T>, waitsMs: readonly number[] = WAITS_MS): Promise<T> {
  for (const waitMs of waitsMs) {
    try {
      return await load();
    } catch {
      await new Promise((resolve) => setTimeout(resolve, waitMs));
    }
  }
  return load();
}

/** Load every part now: a page that loses its server afterwards can still show all of them. */
export async function loadDeferred(): Promise<void> {
  for (const load of loads) await load().catch(() => {});
}
