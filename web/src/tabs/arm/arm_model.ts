/** State and actions of the Arm tab, created when the tab opens and discarded when it closes. */
import { createContext, use } from "react";
import { type StoreApi, create, createStore } from "zustand";
import { JOINTS, SERVICES } from "@/generated/graph";
import type { trajectory_msgs_JointTrajectory } from "@/generated/messages";
import { ARM_PRESETS, PRESET_DURATION_S } from "@/generated/robot";
import { textIn, useLanguage } from "@/i18n/text";
import { call } from "@/robot/commands";
import { showProblem } from "@/state/problems";
import { setting } from "@/state/settings";
import type { CalibrationState } from "./calibration";
import { type Commands, jointCommand, moveCommands, trajectoryCommands } from "./commands";
import { type Angles, type Joint, type JointName, anglesOf, clampToLimits } from "./joints";
import { type Torque, type TorqueEvent, nextTorque } from "./torque";

/** Switching the torque calls two services of the servo driver, and may wait until an earlier switching has ended. */
const TORQUE_TIMEOUT_MS = 15_000;
/** A command within this tolerance of a slider's value is assumed to come from that slider. */
const SAME_COMMAND_TOLERANCE_DEG = 0.5;

export type PresetName = keyof typeof ARM_PRESETS;
const ALL_JOINTS: readonly JointName[] = [...JOINTS.arm, JOINTS.gripper];
export const PRESETS = Object.keys(ARM_PRESETS) as PresetName[];

interface ArmState {
  torque: Torque;
  /** The torque state that was requested and is not confirmed yet; null if no switching is in progress. */
  switchingTo: boolean | null;
  /** The robot's answer to the last switching. */
  answer: string;
  /** Where the operator put a slider; a slider without a value follows the measured angle. */
  thumbs: Angles;
  commands: Commands;
  calibration: CalibrationState | null;
}

export interface Arm {
  store: StoreApi<ArmState>;
  applyTorqueEvent: (event: TorqueEvent) => void;
  switchTorque: (on: boolean) => Promise<void>;
  /** Show a slider where the operator drags it; nothing is sent. */
  setThumb: (joint: Joint, degrees: number) => void;
  /** Move a joint to an angle from where it is now. */
  move: (joint: Joint, degrees: number, measuredDeg: number | undefined) => void;
  goToPreset: (name: PresetName) => Promise<void>;
  onTrajectory: (message: trajectory_msgs_JointTrajectory) => void;
  setCalibration: (state: CalibrationState | null) => void;
  /** Let a slider follow the measured angle again; all sliders if `joint` is omitted. */
  follow: (joint?: Joint) => void;
}

/** The model of the Arm tab that is open, for what commands the arm from elsewhere. */
export const useOpenArm = create<{ arm: Arm | null }>(() => ({ arm: null }));

const ARM_CONTEXT = createContext<Arm | null>(null);
export const ArmProvider = ARM_CONTEXT.Provider;

export function useArmModel(): Arm {
  const arm = use(ARM_CONTEXT);
  if (arm === null) throw new Error("useArmModel must be called inside ArmProvider");
  return arm;
}

/** The service returns only success or failure; the reason is in the robot's log. */
function refusal(joint: Joint): string {
  const { language } = useLanguage.getState();
  return textIn(language, "arm_joint_refused", { joint: textIn(language, joint.label) });
}

export function createArm(): Arm {
  const store = createStore<ArmState>(() => ({ torque: null, switchingTo: null, answer: "", thumbs: {}, commands: {}, calibration: null }));
  /** Per joint, the newest move, to be sent when the current call returns. */
  const pendingMoves = new Map<JointName, () => void>();
  const calling = new Set<JointName>();

  function applyTorqueEvent(event: TorqueEvent): void {
    const { torque } = store.getState();
    const next = nextTorque(torque, event);
    // Without torque the arm ignores commands; they are dropped, so that it is not reported as stalled.
    if (next !== torque) store.setState({ torque: next, thumbs: {}, ...(next === false ? { commands: {} } : {}) });
  }

  async function switchTorque(on: boolean): Promise<void> {
    store.setState({ switchingTo: on, answer: "", thumbs: {} });
    try {
      const answer = await call(SERVICES.ARM_SET_TORQUE, { data: on }, TORQUE_TIMEOUT_MS);
      if (!answer.success) throw new Error(answer.message);
      applyTorqueEvent({ kind: "confirmed", on });
      store.setState({ answer: answer.message });
    } catch (error) {
      applyTorqueEvent({ kind: "failed" });
      showProblem(error);
    } finally {
      store.setState({ switchingTo: null });
    }
  }

  function setThumb(joint: Joint, degrees: number): void {
    store.setState(({ thumbs }) => ({ thumbs: { ...thumbs, [joint.name]: clampToLimits(joint, degrees) } }));
  }

  function move(joint: Joint, degrees: number, measuredDeg: number | undefined): void {
    const target = clampToLimits(joint, degrees);
    setThumb(joint, target);
    // One call per joint at a time, and then only the newest angle: a queue of old angles would lag behind the operator.
    if (calling.has(joint.name)) pendingMoves.set(joint.name, () => move(joint, target, measuredDeg));
    else void send(joint, target, measuredDeg);
  }

  async function send(joint: Joint, target: number, measuredDeg: number | undefined): Promise<void> {
    const rate = setting("armRateDegPerSec");
    calling.add(joint.name);
    try {
      const answer = await call(joint.service, { angle: target, rate, degrees: true });
      if (!answer.status) throw new Error(refusal(joint));
      const command = jointCommand(joint, target, measuredDeg, rate, performance.now());
      store.setState(({ commands }) => ({ commands: { ...commands, [joint.name]: command } }));
    } catch (error) {
      followMeasured([joint.name]);
      pendingMoves.delete(joint.name);
      showProblem(error);
    }
    calling.delete(joint.name);
    const next = pendingMoves.get(joint.name);
    pendingMoves.delete(joint.name);
    next?.();
  }

  async function goToPreset(name: PresetName): Promise<void> {
    try {
      const answer = await call(SERVICES.ARM_PRESET, { name });
      if (!answer.success) throw new Error(answer.message);
      applyExternalCommands(moveCommands(anglesOf(ARM_PRESETS[name]), PRESET_DURATION_S, performance.now()));
    } catch (error) {
      showProblem(error);
    }
  }

  /** Store commands that may come from elsewhere; a slider whose value differs from its command follows the measured angle again. */
  function applyExternalCommands(commands: Commands): void {
    const { thumbs } = store.getState();
    const moved = JOINTS.arm.filter((name) => {
      const [thumb, command] = [thumbs[name], commands[name]];
      return thumb !== undefined && command !== undefined && !calling.has(name) && Math.abs(thumb - command.targetDeg) > SAME_COMMAND_TOLERANCE_DEG;
    });
    store.setState((state) => ({ commands: { ...state.commands, ...commands } }));
    if (moved.length > 0) followMeasured(moved);
  }

  function followMeasured(names: readonly JointName[]): void {
    store.setState(({ thumbs }) => {
      const rest = { ...thumbs };
      for (const name of names) delete rest[name];
      return { thumbs: rest };
    });
  }

  return {
    store,
    applyTorqueEvent,
    switchTorque,
    setThumb,
    move,
    goToPreset,
    onTrajectory: (message) => applyExternalCommands(trajectoryCommands(message, performance.now())),
    setCalibration: (calibration) => store.setState({ calibration }),
    follow: (joint) => {
      if (Object.keys(store.getState().thumbs).length > 0) followMeasured(joint === undefined ? ALL_JOINTS : [joint.name]);
    },
  };
}
