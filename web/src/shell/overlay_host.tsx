import { type ComponentType, Suspense, useEffect } from "react";
import { showProblem } from "@/state/problems";
import { showTab } from "@/state/route";
import { TABS } from "@/tabs/table";
import { Boundary, type FallbackProps } from "@/ui/boundary";
import { deferred } from "@/ui/deferred";
import { isShortcut } from "@/ui/keyboard";
import { isDialogOpen } from "@/ui/open_dialogs";
import { CommandPalette } from "./command_palette";
import { type OverlayName, showOverlay, useOverlay } from "@/state/overlays";

/**
 * The palette is there at once: who opens it goes on typing, and a key that is lost would choose another command.
 * The dialog of control is part of the top bar.
 */
const OVERLAYS: Partial<Record<OverlayName, ComponentType>> = {
  settings: deferred(() => import("./settings_drawer")),
  doctor: deferred(() => import("./doctor_drawer")),
  palette: CommandPalette,
  keys: deferred(() => import("./key_map")),
  runs: deferred(() => import("./runs_dialog")),
  share: deferred(() => import("./share_dialog")),
};

/** The drawers and dialogs of the shell, and the keys that open them from everywhere. */
export function OverlayHost() {
  const shown = useOverlay((state) => state.shown);
  useOverlayKeys();
  const Shown = shown === null ? undefined : OVERLAYS[shown];
  return (
    <Boundary key={shown} fallback={Closed}>
      <Suspense>{Shown !== undefined && <Shown />}</Suspense>
    </Boundary>
  );
}

/** An overlay that failed closes, with the reason as a message. */
function Closed({ reason }: FallbackProps) {
  useEffect(() => {
    showProblem(reason);
    showOverlay(null);
  }, [reason]);
  return null;
}

function useOverlayKeys(): void {
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      if (event.code === "KeyK" && (event.ctrlKey || event.metaKey) && !event.altKey) {
        event.preventDefault();
        showOverlay(useOverlay.getState().shown === "palette" ? null : "palette");
        return;
      }
      if (!isShortcut(event)) return;
      if (event.key === "?") showOverlay("keys");
      const digit = /^Digit([1-9])$/.exec(event.code)?.[1];
      const tab = digit === undefined || event.shiftKey ? undefined : TABS[Number(digit) - 1];
      if (tab !== undefined && !isDialogOpen()) showTab(tab.id);
    };
    window.addEventListener("keydown", onKey);
    return () => window.removeEventListener("keydown", onKey);
  }, []);
}
