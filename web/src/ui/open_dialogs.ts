/** How many dialogs and drawers are open. While one is, the keys of the views behind it do nothing. */
import { create } from "zustand";

export const useOpenDialogs = create<{ count: number }>(() => ({ count: 0 }));

export function isDialogOpen(): boolean {
  return useOpenDialogs.getState().count > 0;
}

/** Count a dialog as open; returns the function that counts it as closed. */
export function countDialog(): () => void {
  useOpenDialogs.setState(({ count }) => ({ count: count + 1 }));
  return () => useOpenDialogs.setState(({ count }) => ({ count: count - 1 }));
}
