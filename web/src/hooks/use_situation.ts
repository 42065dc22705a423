/** What the whole page shows of the robot: its e-stop, mission, drive bus and battery. */
import { useMemo } from "react";
import { hasControl, useConsole } from "@/api/console_store";
import { TOPICS } from "@/generated/graph";
import { useText } from "@/i18n/text";
import type { Sample } from "@/ros/topics";
import { useIsRewound } from "@/rewind/state";
import { useGate, useLink } from "@/robot";
import { useTabRole } from "@/safety/commanding_tab";
import { type DriveFacts, type Reason, driveObstacles, motionObstacles, parseDriveStatus, parseEstopReasons, relocationObstacles } from "@/state/can_drive";
import { MISSION_STALE_MS } from "@/state/mission_age";
import { type Sentence, isActive, sentence } from "@/state/sentence";
import { useSetting } from "@/state/settings";
import { useNow, useTimeValue } from "./use_now";
import { useTopic } from "./use_topic";

/** `/e_stop_state` comes five times a second; older than this it says nothing about now. */
export const ESTOP_STALE_MS = 1500;

/** Whether the robot is stopped as it says itself; null before it said so, or where that is out of date. */
export function useEstop(): { engaged: boolean | null; reasons: string[]; receivedMs: number | null } {
  const state = useTopic(TOPICS.ESTOP_STATE);
  const status = useTopic(TOPICS.ESTOP_STATUS);
  const now = useNow();
  const reasons = useMemo(() => parseEstopReasons(status?.message.data ?? "")?.reasons ?? [], [status]);
  const fresh = state !== undefined && now - state.receivedMs < ESTOP_STALE_MS;
  return {
    engaged: fresh ? state.message.data : null,
    reasons: fresh && state.message.data ? reasons : [],
    receivedMs: state?.receivedMs ?? null,
  };
}

/** The mission's state; null before it came, and where it is out of date. */
export function useMission() {
  const sample = useTopic(TOPICS.MISSION_STATE);
  return useIsFresh(sample, MISSION_STALE_MS) ? (sample?.message ?? null) : null;
}

/** When the mission's state came last, if that is too long ago; null while it comes, and where it never came. */
export function useMissionSilence(): number | null {
  const sample = useTopic(TOPICS.MISSION_STATE);
  const isFresh = useIsFresh(sample, MISSION_STALE_MS);
  return sample === undefined || isFresh ? null : sample.receivedMs;
}

/** The drive bus repeats its status every second. */
const BUS_STALE_MS = 3000;

/** The drive bus's status; null before it came, and where it is out of date. */
export function useDriveStatus() {
  const status = useTopic(TOPICS.DRIVE_STATUS);
  const parsed = useMemo(() => (status === undefined ? null : parseDriveStatus(status.message.data)), [status]);
  return useIsFresh(status, BUS_STALE_MS) ? parsed : null;
}

function useIsFresh(sample: Sample<unknown> | undefined, staleMs: number): boolean {
  return useTimeValue((now) => sample !== undefined && now - sample.receivedMs <= staleMs);
}

export function useSentence(): Sentence {
  const link = useLink();
  const estop = useEstop();
  const mission = useMission();
  const bus = useDriveStatus();
  const heldAtZero = useHeldAtZero();
  const isMissionSilent = useMissionSilence() !== null;
  return sentence({
    isMissionSilent,
    linkOpen: link.state === "open",
    wasOpen: link.wasOpen,
    stopped: estop.engaged,
    mission,
    // A page in control whose gate is engaged holds the manual input with zeros: that is no driving.
    drivenByHand: bus?.winner === "joy" || (bus?.winner === "manual" && !heldAtZero),
    heldAtZero,
  });
}

/** Every reason for which the sticks would not move the robot now. */
export function useDriveObstacles(): Reason[] {
  return driveObstacles(useDriveFacts());
}

/** Every reason for which neither a goal nor the arm can be commanded now, and those that only the wheels have. */
export function useMotionObstacles(): Reason[] {
  return motionObstacles(useDriveFacts());
}

/** Every reason for which the robot cannot be told now that it is elsewhere on the map. It may be stopped, but must not be driving. */
export function useRelocationObstacles(): Reason[] {
  return relocationObstacles(useDriveFacts());
}

/** Whether a mission moves the robot now. */
export function useMissionDrives(): boolean {
  const mission = useMission();
  return mission !== null && isActive(mission) && !mission.paused;
}

/** Whether this page holds the wheels at zero velocity, so that a mission cannot move the robot. */
export function useHeldAtZero(): boolean {
  const bus = useDriveStatus();
  const gateEngaged = useGate((gate) => gate.engaged);
  const isWatching = useTabRole(({ role }) => role === "watching");
  const inControl = useConsole(hasControl) && !isWatching;
  return bus?.winner === "manual" && gateEngaged && inControl;
}

function useDriveFacts(): DriveFacts {
  const text = useText();
  const linkOpen = useLink((link) => link.state === "open");
  const server = useConsole();
  const gate = useGate();
  const estop = useEstop();
  const missionDrives = useMissionDrives();
  const bus = useDriveStatus();
  const isRewound = useIsRewound();
  const isWatching = useTabRole(({ role }) => role === "watching");
  return {
    linkOpen,
    isRewound,
    isWatching,
    role: server.session?.role ?? null,
    holder: server.control.holder,
    inControl: hasControl(server),
    gateReason: gate.engaged && gate.reason !== null ? text(`reason_${gate.reason}`) : null,
    estopReasons: estop.engaged === true ? (estop.reasons.length > 0 ? estop.reasons : [text("is_stopped")]) : [],
    missionDrives,
    bus,
  };
}

/** The battery sends once a second. */
export const BATTERY_STALE_MS = 5000;

export function useBattery() {
  const name = useSetting("batteryTopic");
  return useTopic({ name, type: TOPICS.BATTERY.type });
}
