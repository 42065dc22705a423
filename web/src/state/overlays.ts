/** Which drawer or dialog of the shell is open: one at a time, opened from anywhere. */
import { create } from "zustand";

export type OverlayName = "settings" | "doctor" | "palette" | "keys" | "control" | "runs" | "share";

export const useOverlay = create<{ shown: OverlayName | null }>(() => ({ shown: null }));

export function showOverlay(shown: OverlayName | null): void {
  useOverlay.setState({ shown });
}

/** Whether an overlay is open, and the function that opens or closes it. */
export function useOverlayState(name: OverlayName): [boolean, (open: boolean) => void] {
  const isOpen = useOverlay((state) => state.shown === name);
  return [isOpen, (open) => showOverlay(open ? name : null)];
}
