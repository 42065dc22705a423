import { type ComponentType, type LazyExoticComponent, Suspense, lazy, useEffect } from "react";
import { showTab } from "@/state/route";
import { TABS } from "@/tabs/table";
import { type OverlayName, showOverlay, useOverlay } from "./overlays";

/** What is loaded when it is opened for the first time. The dialog of control is part of the top bar. */
const OVERLAYS: Partial<Record<OverlayName, LazyExoticComponent<ComponentType>>> = {
  settings: lazy(() => import("./settings_drawer")),
  doctor: lazy(() => import("./doctor_drawer")),
  palette: lazy(() => import("./command_palette")),
  keys: lazy(() => import("./key_map")),
  runs: lazy(() => import("./runs_dialog")),
  share: lazy(() => import("./share_dialog")),
};

/** The drawers and dialogs of the shell, and the keys that open them from everywhere. */
export function OverlayHost() {
  const shown = useOverlay((state) => state.shown);
  useOverlayKeys();
  const Shown = shown === null ? undefined : OVERLAYS[shown];
  return <Suspense>{Shown !== undefined && <Shown />}</Suspense>;
}

function useOverlayKeys(): void {
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      if (event.code === "KeyK" && (event.ctrlKey || event.metaKey) && !event.altKey) {
        event.preventDefault();
        showOverlay(useOverlay.getState().shown === "palette" ? null : "palette");
        return;
      }
      if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || isField(event.target)) return;
      if (event.key === "?") showOverlay("keys");
      const digit = /^Digit([1-9])$/.exec(event.code)?.[1];
      const tab = digit === undefined || event.shiftKey ? undefined : TABS[Number(digit) - 1];
      if (tab !== undefined && useOverlay.getState().shown === null) showTab(tab.id);
    };
    window.addEventListener("keydown", onKey);
    return () => window.removeEventListener("keydown", onKey);
  }, []);
}

function isField(target: EventTarget | null): boolean {
  if (!(target instanceof HTMLElement)) return false;
  return target.isContentEditable || target instanceof HTMLInputElement || target instanceof HTMLTextAreaElement || target instanceof HTMLSelectElement;
}
