/** What the whole page shows of the robot: its e-stop, mission, drive bus and battery. */
import { useMemo } from "react";
import { hasControl, useConsole } from "@/api/console_store";
import { TOPICS } from "@/generated/graph";
import { useText } from "@/i18n/text";
import { useGate, useLink } from "@/robot";
import { type Reason, driveObstacles, parseDriveStatus, parseEstopReasons } from "@/state/can_drive";
import { type Sentence, isActive, sentence } from "@/state/sentence";
import { useSetting } from "@/state/settings";
import { useNow } from "./use_now";
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

export function useMission() {
  return useTopic(TOPICS.MISSION_STATE)?.message ?? null;
}

export function useDriveStatus() {
  const status = useTopic(TOPICS.DRIVE_STATUS);
  return useMemo(() => (status === undefined ? null : parseDriveStatus(status.message.data)), [status]);
}

export function useSentence(): Sentence {
  const link = useLink();
  const estop = useEstop();
  const mission = useMission();
  const bus = useDriveStatus();
  const gateEngaged = useGate((gate) => gate.engaged);
  const holdsZeros = useConsole(hasControl) && gateEngaged;
  return sentence({
    linkOpen: link.state === "open",
    wasOpen: link.wasOpen,
    stopped: estop.engaged,
    mission,
    // A page in control whose gate is engaged holds the manual input with zeros: that is no driving.
    drivenByHand: bus?.winner === "joy" || (bus?.winner === "manual" && !holdsZeros),
  });
}

/** Every reason for which the sticks would not move the robot now. */
export function useDriveObstacles(): Reason[] {
  const text = useText();
  const linkOpen = useLink((link) => link.state === "open");
  const server = useConsole();
  const gate = useGate();
  const estop = useEstop();
  const mission = useMission();
  const bus = useDriveStatus();
  return driveObstacles({
    linkOpen,
    role: server.own?.role ?? null,
    holder: server.control.holder,
    inControl: hasControl(server),
    gateReason: gate.engaged && gate.reason !== null ? text(`reason_${gate.reason}`) : null,
    estopReasons: estop.engaged === true ? (estop.reasons.length > 0 ? estop.reasons : [text("is_stopped")]) : [],
    missionDrives: mission !== null && isActive(mission) && !mission.paused,
    bus,
  });
}

export function useBattery() {
  const name = useSetting("batteryTopic");
  return useTopic({ name, type: TOPICS.BATTERY.type });
}
