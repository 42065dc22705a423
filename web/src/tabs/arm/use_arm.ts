/** The arm's state as the robot reports it, and the reasons why this page may not move it. */
import { useEffect, useMemo } from "react";
import { useStore } from "zustand";
import { TOPICS } from "@/generated/graph";
import { useNow } from "@/hooks/use_now";
import { useMotionObstacles } from "@/hooks/use_situation";
import { useSamples, useTopic } from "@/hooks/use_topic";
import type { TextKey } from "@/i18n/text";
import { useLink } from "@/robot/link";
import type { Reason } from "@/state/can_drive";
import { useSetting } from "@/state/settings";
import { type Arm, createArm, useArmModel, useOpenArm } from "./arm_model";
import { type Angles, measuredAngles } from "./joints";
import { type LibraryState, isArmBusy, parseLibraryState } from "./library";

/** Joint states arrive 50 times a second; they are drawn at most 20 times. */
export const JOINTS_THROTTLE = { throttleMs: 50 };
export const JOINTS_STALE_MS = 1000;
const LIBRARY_STALE_MS = 1500;

export interface Measured {
  /** The angles that were measured last. */
  last: Angles;
  /** The same while they are fresh; empty otherwise. */
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

/** What the arm's library does now; null until it is known, and once the last message is older than LIBRARY_STALE_MS. */
export function useLibraryState(): LibraryState | null {
  const sample = useTopic(TOPICS.ARM_LIBRARY_STATE);
  const nowMs = useNow();
  const state = useMemo(() => (sample === undefined ? null : parseLibraryState(sample.message.data)), [sample]);
  return sample !== undefined && nowMs - sample.receivedMs < LIBRARY_STALE_MS ? state : null;
}

/** Of the reasons that keep the wheels from moving, those that keep the arm from moving too. */
const SHARED_REASONS: readonly TextKey[] = ["why_no_link", "why_other_tab", "why_viewer", "why_estop", "why_control", "why_gate", "why_hold_first", "why_mission"];

/** Why this page may not command the arm, whatever its torque; the most immediate reason first. */
export function useArmObstacles(): Reason[] {
  return useMotionObstacles().filter(({ key }) => SHARED_REASONS.includes(key));
}

/** Why the library cannot be used: it needs a link, control and a released e-stop, but neither torque nor a paused mission. */
export function useLibraryObstacles(): Reason[] {
  return useArmObstacles().filter(({ key }) => key !== "why_mission");
}

/** Why sliders, nudges and presets are blocked. */
export function useSliderObstacles(library: LibraryState | null, measured: Measured): Reason[] {
  const { store } = useArmModel();
  return useObstaclesOf(store, library, measured);
}

/** Why the presets are blocked, outside of the Arm tab too: there the torque is unknown. */
export function usePresetObstacles(): Reason[] {
  const library = useLibraryState();
  const measured = useMeasured();
  const store = useOpenArm((open) => open.arm?.store) ?? CLOSED.store;
  return useObstaclesOf(store, library, measured);
}

const CLOSED = createArm();

function useObstaclesOf(store: Arm["store"], library: LibraryState | null, measured: Measured): Reason[] {
  const torque = useStore(store, (arm) => arm.torque);
  const calibration = useStore(store, (arm) => arm.calibration);
  const reasons = useArmObstacles();
  if (reasons[0]?.key === "why_no_link") return reasons;
  const own: Reason[] = [];
  if (calibration === "AWAITING_POSE") own.push({ key: "arm_why_calibrating" });
  if (isArmBusy(library)) own.push({ key: library?.playing === true ? "arm_why_playing" : "arm_why_recording" });
  if (torque !== true) own.push({ key: torque === false ? "arm_why_torque_off" : "arm_why_torque_unknown" });
  if (Object.keys(measured.now).length === 0) own.push({ key: "arm_why_no_pose" });
  return [...reasons, ...own];
}

/** Passes the robot's messages to the model, and lets blocked sliders follow the arm. */
export function useArmReports(library: LibraryState | null, isBlocked: boolean): void {
  const { applyTorqueEvent, onTrajectory, follow } = useArmModel();
  const isLinkOpen = useLink((link) => link.state === "open");
  useSamples(TOPICS.ARM_TRAJECTORY, ({ message }) => onTrajectory(message));
  useEffect(() => {
    if (!isLinkOpen) applyTorqueEvent({ kind: "link-lost" });
  }, [isLinkOpen, applyTorqueEvent]);
  const torque = library?.torque;
  useEffect(() => {
    if (torque !== undefined) applyTorqueEvent({ kind: "reported", on: torque });
  }, [torque, applyTorqueEvent]);
  useEffect(() => {
    if (isBlocked) follow();
  }, [isBlocked, follow]);
}
