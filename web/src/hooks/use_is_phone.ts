import { useSyncExternalStore } from "react";

const phone = window.matchMedia("(max-width: 767.98px)");

function subscribe(changed: () => void): () => void {
  phone.addEventListener("change", changed);
  return () => phone.removeEventListener("change", changed);
}

/** Whether the window is as narrow as a phone's: then the tabs lie at its bottom. */
export function useIsPhone(): boolean {
  return useSyncExternalStore(subscribe, () => phone.matches);
}
