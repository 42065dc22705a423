/** The drive path: what this page's sticks, keys and pads command, and why they cannot. */
import { create } from "zustand";
import { hasControl, useConsole } from "@/api/console_store";
import { isRewound } from "@/state/rewind";
import { isWatching } from "@/safety/commanding_tab";
import { type Blocker, Driver, type Velocity, ZERO } from "@/safety/drive";
import { setting } from "@/state/settings";
import { link } from "./link";
import { gate, useGate } from "./stop";
import { sendVelocity } from "./velocity";

interface DriveStore {
  commanded: Velocity;
  blocker: Blocker | null;
}

export const useDrive = create<DriveStore>(() => ({ commanded: ZERO, blocker: null }));

/** Why this page cannot command a velocity now; null where it can. */
export function driveBlocker(): Blocker | null {
  const state = useConsole.getState();
  if (!link.isOpen) return "no-link";
  if (isRewound()) return "rewound";
  if (isWatching()) return "other-tab";
  if (state.session?.role === "viewer") return "viewer";
  if (gate.engaged) return "stopped";
  if (state.control.holder !== null && !hasControl(state)) return "no-control";
  return null;
}

export const driver = new Driver(sendVelocity, driveBlocker, (commanded, blocker) => useDrive.setState({ commanded, blocker }), () => setting("speedScale"));

useGate.subscribe(({ engaged }) => {
  if (engaged) driver.letGo();
});
