import { useSyncExternalStore } from "react";

const query = typeof window.matchMedia === "function" ? window.matchMedia("(max-width: 767.98px)") : null;

function subscribe(changed: () => void): () => void {
  query?.addEventListener("change", changed);
  return () => query?.removeEventListener("change", changed);
}

/** Whether the page is one column wide. */
export function useIsNarrow(): boolean {
  return useSyncExternalStore(subscribe, () => query?.matches ?? false);
}
