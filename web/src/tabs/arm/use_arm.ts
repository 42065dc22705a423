/** The arm as the robot reports it, and what keeps this page from moving it. */
import { useEffect, useMemo } from "react";
import { TOPICS } from "@/generated/graph";
import { useNow } from "@/hooks/use_now";
import { useDriveObstacles } from "@/hooks/use_situation";
import { useSamples, useTopic } from "@/hooks/use_topic";
import type { TextKey } from "@/i18n/text";
import { useLink } from "@/robot";
import type { Reason } from "@/state/can_drive";
import { useSetting } from "@/state/settings";
import { useArmModel } from "./arm_model";
import { type Angles, measuredAngles } from "./joints";
import { type LibraryState, isArmBusy, parseLibraryState } from "./library";

/** Joint states come 50 times a second; this many are drawn. */
export const JOINTS_THROTTLE = { throttleMs: 50 };
export const JOINTS_STALE_MS = 1000;
const LIBRARY_STALE_MS = 1500;

export interface Measured {
  /** What was measured last. */
  last: Angles;
  /** The same while it is fresh; empty otherwise. */
  now: Angles;
  receivedMs: number | null;
}

export function useMeasured(): Measured {
  const name = useSetting("jointStatesTopic");
  const sample = useTopic({ name, type: TOPICS.JOINT_STATES.type }, JOINTS_THROTTLE);
  const nowMs = useNow();
  const last = useMemo(() => (sample === undefined ? {} : measuredAngles(sample.message)), [sample]);
  const isFresh = sample !== undefined && nowMs - sample.receivedMs < JOINTS_STALE_MS;
  return { last, now: isFresh ? last : NO_ANGLES, receivedMs: sample?.receivedMs ?? null };
}

const NO_ANGLES: Angles = {};

/** What the arm's library does now; null before it said so, and when that is out of date. */
export function useLibraryState(): LibraryState | null {
  const sample = useTopic(TOPICS.ARM_LIBRARY_STATE);
  const nowMs = useNow();
  const state = useMemo(() => (sample === undefined ? null : parseLibraryState(sample.message.data)), [sample]);
  return sample !== undefined && nowMs - sample.receivedMs < LIBRARY_STALE_MS ? state : null;
}

/** Of the reasons that keep the wheels from moving, those that keep the arm from moving too. */
const SHARED_REASONS: readonly TextKey[] = ["why_no_link", "why_viewer", "why_estop", "why_control", "why_gate", "why_mission"];

/** Why nothing of the arm may be commanded from here, whatever its torque; the nearest reason first. */
export function useArmObstacles(): Reason[] {
  return useDriveObstacles().filter(({ key }) => SHARED_REASONS.includes(key));
}

/** Why the library cannot be used: it needs a link, control and no e-stop, but neither torque nor a mission that pauses. */
export function useLibraryObstacles(): Reason[] {
  return useArmObstacles().filter(({ key }) => key !== "why_mission");
}

/** Why sliders, nudges and presets are blocked. */
export function useSliderObstacles(library: LibraryState | null, measured: Measured): Reason[] {
  const { use } = useArmModel();
  const torque = use((arm) => arm.torque);
  const calibration = use((arm) => arm.calibration);
  const reasons = useArmObstacles();
  if (reasons[0]?.key === "why_no_link") return reasons;
  const own: Reason[] = [];
  if (calibration === "AWAITING_POSE") own.push({ key: "arm_why_calibrating" });
  if (isArmBusy(library)) own.push({ key: library?.playing === true ? "arm_why_playing" : "arm_why_recording" });
  if (torque !== true) own.push({ key: torque === false ? "arm_why_torque_off" : "arm_why_torque_unknown" });
  if (Object.keys(measured.now).length === 0) own.push({ key: "arm_why_no_pose" });
  return [...reasons, ...own];
}

/** Keeps the model informed by what the robot says, and lets blocked sliders follow the arm. */
export function useArmReports(library: LibraryState | null, isBlocked: boolean): void {
  const { tell, takeTrajectory, follow } = useArmModel();
  const isLinkOpen = useLink((link) => link.state === "open");
  useSamples(TOPICS.ARM_TRAJECTORY, ({ message }) => takeTrajectory(message));
  useEffect(() => {
    if (!isLinkOpen) tell({ kind: "link-lost" });
  }, [isLinkOpen, tell]);
  const torque = library?.torque;
  useEffect(() => {
    if (torque !== undefined) tell({ kind: "reported", on: torque });
  }, [torque, tell]);
  useEffect(() => {
    if (isBlocked) follow();
  }, [isBlocked, follow]);
}
