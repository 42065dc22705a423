/** What the whole page shows of the robot: its e-stop, mission, drive bus and battery. */
import { useMemo, useRef } from "react";
import { hasControl, useConsole } from "@/api/console_store";
import { TOPICS } from "@/generated/graph";
import type { nav_msgs_Odometry } from "@/generated/messages";
import { namedIn, wordsIn } from "@/i18n/robot_words";
import { type TextKey, useLanguage, useText } from "@/i18n/text";
import type { Sample } from "@/ros/topics";
import { useIsRewound } from "@/state/rewind";
import { useLink } from "@/robot/link";
import { gate as stopGate, useGate } from "@/robot/stop";
import { useTabRole } from "@/safety/commanding_tab";
import { type DriveFacts, type Reason, driveAnswer, driveObstacles, motionObstacles, parseDriveStatus, parseEstopReasons, relocationObstacles } from "@/state/can_drive";
import { MISSION_STALE_MS } from "@/state/mission_age";
import { type Sentence, isActive, sentence } from "@/state/sentence";
import { useSetting } from "@/state/settings";
import { stopLines } from "@/state/stop_reasons";
import { type Wheels, type WheelsReading, nextReading, wheelsAt } from "@/state/wheels";
import { useNow, useTimeValue } from "./use_now";
import { useSamples, useTopic, useTopics } from "./use_topic";

/** `/e_stop_state` comes five times a second; older than this it says nothing about now. */
export const ESTOP_STALE_MS = 1500;

/** Whether the link to the robot was lost, so that every value of the robot is of the past. */
export function useIsLinkLost(): boolean {
  return useLink((link) => link.lostMs !== null);
}

/** Whether what is known of control is of the past. */
export function useIsControlStale(): boolean {
  const isOffline = useConsole(({ sessionLoaded, online, onlineChangedMs }) => sessionLoaded && !online && onlineChangedMs > 0);
  return useIsLinkLost() || isOffline;
}

interface Estop {
  /** Whether the robot is stopped as it says itself; null before it said so, or where that is out of date. */
  engaged: boolean | null;
  /** What it said last, however long ago; null before it said anything. */
  lastEngaged: boolean | null;
  reasons: string[];
  receivedMs: number | null;
}

export function useEstop(): Estop {
  const state = useTopic(TOPICS.ESTOP_STATE);
  const status = useTopic(TOPICS.ESTOP_STATUS);
  const now = useNow();
  const reasons = useMemo(() => parseEstopReasons(status?.message.data ?? "")?.reasons ?? [], [status]);
  const fresh = state !== undefined && now - state.receivedMs < ESTOP_STALE_MS;
  return {
    engaged: fresh ? state.message.data : null,
    lastEngaged: state?.message.data ?? null,
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

/** Navigation sends a velocity 20 times a second while it has a goal, be it zero, and nothing otherwise. */
const GOAL_THROTTLE = { throttleMs: 250 };
const GOAL_STALE_MS = 1000;

/** Whether navigation pursues a goal, also while another input outranks it on the drive bus. */
export function useNavigates(): boolean {
  const store = useTopics();
  useSamples(TOPICS.CMD_VEL_NAV, () => {}, GOAL_THROTTLE);
  const commands = useTimeValue((now) => {
    const sample = store.last(TOPICS.CMD_VEL_NAV, GOAL_THROTTLE);
    return sample !== undefined && now - sample.receivedMs <= GOAL_STALE_MS;
  });
  const wins = useDriveStatus()?.winner === "auto";
  return commands || wins;
}

function useWheels(): Wheels {
  const name = useSetting("odomTopic");
  const reading = useRef<WheelsReading | null>(null);
  const take = ({ message, receivedMs }: Sample<nav_msgs_Odometry>) => {
    reading.current = nextReading(reading.current, message.twist.twist, receivedMs);
  };
  useSamples({ name, type: TOPICS.ODOM.type }, take, { throttleMs: 100 });
  return useTimeValue((now) => wheelsAt(reading.current, now));
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
  const navigates = useNavigates();
  const wheels = useWheels();
  return sentence({
    isMissionSilent,
    linkOpen: link.state === "open" && link.lostMs === null,
    wasOpen: link.wasOpen,
    stopped: estop.engaged,
    mission,
    winner: bus?.winner ?? null,
    navigates,
    wheels,
    heldAtZero,
  });
}

/** Every reason for which the sticks would not move the robot now, and what they do without one. */
export function useCanDrive(): { reasons: Reason[]; yes: TextKey } {
  const facts = useDriveFacts();
  return { reasons: driveObstacles(facts), yes: driveAnswer(facts) };
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
  const language = useLanguage((store) => store.language);
  const linkOpen = useLink(({ state, lostMs }) => state === "open" && lostMs === null);
  const server = useConsole();
  const gate = useGate();
  const estop = useEstop();
  const missionDrives = useMissionDrives();
  const isMissionSilent = useMissionSilence() !== null;
  const navigates = useNavigates();
  const bus = useDriveStatus();
  const isRewound = useIsRewound();
  const isWatching = useTabRole(({ role }) => role === "watching");
  const own = gate.isStated && gate.reason !== null ? { press: stopGate.press, key: `reason_${gate.reason}` as const, ageS: null } : null;
  const stops = stopLines({ own, name: server.session?.name ?? "", server: server.stop, robot: estop.reasons });
  return {
    linkOpen,
    isRewound,
    isWatching,
    role: server.session?.role ?? null,
    holder: server.control.holder,
    inControl: hasControl(server),
    gateReason: gate.engaged && gate.reason !== null ? text(`reason_${gate.reason}`) : null,
    estopReasons: estop.engaged !== true ? [] : stops.length > 0 ? stops.map(({ key, values, words }) => (key === null ? wordsIn(language, words) : text(key, namedIn(language, values)))) : [text("is_stopped")],
    isStopKnown: estop.engaged !== null,
    missionDrives,
    isMissionSilent,
    navigates,
    bus,
    inWords: (words) => wordsIn(language, words),
  };
}

/** The battery sends once a second. */
export const BATTERY_STALE_MS = 5000;

export function useBattery() {
  const name = useSetting("batteryTopic");
  return useTopic({ name, type: TOPICS.BATTERY.type });
}
