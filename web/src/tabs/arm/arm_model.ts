/** What the Arm tab knows and asks for, from its opening to its closing: nothing of it outlives the tab. */
import { createContext, use } from "react";
import { type StoreApi, type UseBoundStore, create } from "zustand";
import { JOINTS, SERVICES } from "@/generated/graph";
import type { trajectory_msgs_JointTrajectory } from "@/generated/messages";
import { ARM_PRESETS, PRESET_DURATION_S } from "@/generated/robot";
import { textIn, useLanguage } from "@/i18n/text";
import { call } from "@/robot";
import { showProblem } from "@/state/problems";
import { setting } from "@/state/settings";
import type { CalibrationState } from "./calibration";
import { type Commands, jointCommand, moveCommands, trajectoryCommands } from "./commands";
import { type Angles, type Joint, type JointName, anglesOf, clampToWindow } from "./joints";
import { type Torque, type TorqueEvent, nextTorque } from "./torque";

/** The switch waits for two services of the servo driver, and perhaps for another switch before it. */
const TORQUE_TIMEOUT_MS = 15_000;
/** A command this near to a slider's value is the slider's own. */
const SAME_DEG = 0.5;

export type PresetName = keyof typeof ARM_PRESETS;
const ALL: readonly JointName[] = [...JOINTS.arm, JOINTS.gripper];
export const PRESETS = Object.keys(ARM_PRESETS) as PresetName[];

interface ArmState {
  torque: Torque;
  /** What the torque is being switched to; null while it is not. */
  switchingTo: boolean | null;
  /** What the robot answered to the last switch. */
  answer: string;
  /** Where the operator put a slider; a slider without a value follows the measured angle. */
  thumbs: Angles;
  commands: Commands;
  calibration: CalibrationState | null;
}

export interface Arm {
  use: UseBoundStore<StoreApi<ArmState>>;
  tell: (event: TorqueEvent) => void;
  switchTorque: (on: boolean) => Promise<void>;
  /** Show a slider where the operator holds it; nothing is sent. */
  hold: (joint: Joint, degrees: number) => void;
  /** Move a joint to an angle from where it is now. */
  move: (joint: Joint, degrees: number, measuredDeg: number | undefined) => void;
  goToPreset: (name: PresetName) => Promise<void>;
  takeTrajectory: (message: trajectory_msgs_JointTrajectory) => void;
  setCalibration: (state: CalibrationState | null) => void;
  /** Let a slider follow the measured angle again; all of them without one. */
  follow: (joint?: Joint) => void;
}

const ARM_CONTEXT = createContext<Arm | null>(null);
export const ArmProvider = ARM_CONTEXT.Provider;

export function useArmModel(): Arm {
  const arm = use(ARM_CONTEXT);
  if (arm === null) throw new Error("used outside of the Arm tab");
  return arm;
}

/** The service answers yes or no; its reason stands in the robot's log. */
function refusal(joint: Joint): string {
  const { language } = useLanguage.getState();
  return textIn(language, "arm_joint_refused", { joint: textIn(language, joint.label) });
}

export function createArm(): Arm {
  const store = create<ArmState>(() => ({ torque: null, switchingTo: null, answer: "", thumbs: {}, commands: {}, calibration: null }));
  /** By joint: an angle that is to be sent when the running call has been answered. */
  const waiting = new Map<JointName, () => void>();
  const calling = new Set<JointName>();

  function tell(event: TorqueEvent): void {
    const { torque } = store.getState();
    const next = nextTorque(torque, event);
    // A limp arm follows no command: it has not stalled.
    if (next !== torque) store.setState({ torque: next, thumbs: {}, ...(next === false ? { commands: {} } : {}) });
  }

  async function switchTorque(on: boolean): Promise<void> {
    store.setState({ switchingTo: on, answer: "", thumbs: {} });
    try {
      const answer = await call(SERVICES.ARM_SET_TORQUE, { data: on }, TORQUE_TIMEOUT_MS);
      if (!answer.success) throw new Error(answer.message);
      tell({ kind: "confirmed", on });
      store.setState({ answer: answer.message });
    } catch (error) {
      tell({ kind: "failed" });
      showProblem(error);
    } finally {
      store.setState({ switchingTo: null });
    }
  }

  function hold(joint: Joint, degrees: number): void {
    store.setState(({ thumbs }) => ({ thumbs: { ...thumbs, [joint.name]: clampToWindow(joint, degrees) } }));
  }

  function move(joint: Joint, degrees: number, measuredDeg: number | undefined): void {
    const target = clampToWindow(joint, degrees);
    hold(joint, target);
    // One call per joint at a time, and only the newest angle after it: a queue of old angles would lag behind the operator.
    if (calling.has(joint.name)) waiting.set(joint.name, () => move(joint, target, measuredDeg));
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
      waiting.delete(joint.name);
      showProblem(error);
    }
    calling.delete(joint.name);
    const next = waiting.get(joint.name);
    waiting.delete(joint.name);
    next?.();
  }

  async function goToPreset(name: PresetName): Promise<void> {
    try {
      const answer = await call(SERVICES.ARM_PRESET, { name });
      if (!answer.success) throw new Error(answer.message);
      take(moveCommands(anglesOf(ARM_PRESETS[name]), PRESET_DURATION_S, performance.now()));
    } catch (error) {
      showProblem(error);
    }
  }

  /** Take commands of which this tab's sliders may not know: a slider that was put elsewhere follows the arm again. */
  function take(commands: Commands): void {
    const { thumbs } = store.getState();
    const moved = JOINTS.arm.filter((name) => {
      const [thumb, command] = [thumbs[name], commands[name]];
      return thumb !== undefined && command !== undefined && !calling.has(name) && Math.abs(thumb - command.targetDeg) > SAME_DEG;
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
    use: store,
    tell,
    switchTorque,
    hold,
    move,
    goToPreset,
    takeTrajectory: (message) => take(trajectoryCommands(message, performance.now())),
    setCalibration: (calibration) => store.setState({ calibration }),
    follow: (joint) => {
      if (Object.keys(store.getState().thumbs).length > 0) followMeasured(joint === undefined ? ALL : [joint.name]);
    },
  };
}
