/** Whether the page shows the past, and which moment of it. */
import { create } from "zustand";

export interface RewindState {
  /** The shown moment, s of the robot's clock; null while the page is live. */
  shownS: number | null;
  isPlaying: boolean;
  isLoading: boolean;
  /** The times that the recording has, s of the robot's clock; null before they are known. */
  extent: { startS: number; endS: number } | null;
  /** Why the shown moment cannot be shown; empty where it can. */
  problem: string;
}

export const LIVE: RewindState = { shownS: null, isPlaying: false, isLoading: false, extent: null, problem: "" };

export const useRewind = create<RewindState>(() => LIVE);

export function isRewound(): boolean {
  return useRewind.getState().shownS !== null;
}

export function useIsRewound(): boolean {
  return useRewind(({ shownS }) => shownS !== null);
}
