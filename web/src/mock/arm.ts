/** The mock arm: joints that move to their targets, torque, the calibration's two states. */
import { JOINTS } from "@/generated/graph";
import { ARM_PRESETS, GRIPPER, JOINT_LIMITS, PRESET_DURATION_S } from "@/generated/robot";

export const ARM_JOINTS = JOINTS.arm;
const GRIPPER_RAD_S = 0.34;
const PUBLISHED_WITHIN_S = 0.5;
const CALIBRATED = ["shoulder_lift", "elbow", "wrist", "gripper"] as const;
/** Differences between zero and a pose that was set by hand, in encoder ticks; below 200 no offset is written. */
const OBSERVED_TICKS = [312, -148, 96, 1204] as const;
const WRITTEN_FROM_TICKS = 200;

/** A request that the arm refuses; the text is for the operator. */
export class Refused extends Error {}

export interface Calibration {
  state: "IDLE" | "AWAITING_POSE";
  message: string;
  joints: string[];
  offsets: number[];
  diffs: number[];
}

interface Move {
  from: readonly number[];
  to: readonly number[];
  beganS: number;
  durationS: number;
}

export class MockArm {
  position: number[] = [...ARM_PRESETS.home];
  velocity: number[] = [0, 0, 0, 0];
  gripper: number = GRIPPER.openRad;
  torque = true;
  calibration: "IDLE" | "AWAITING_POSE" = "IDLE";
  private move: Move | null = null;
  /** The last move, until its trajectory was published. */
  private sent: { to: readonly number[]; durationS: number; beganS: number } | null = null;
  private gripperTarget: number = GRIPPER.openRad;
  private nowS = 0;

  get isMoving(): boolean {
    return this.move !== null || this.gripper !== this.gripperTarget;
  }

  /** Move to a pose in rad, as far as the joints' limits allow. */
  moveTo(target: readonly number[], durationS: number = PRESET_DURATION_S): void {
    if (this.calibration === "AWAITING_POSE") throw new Refused("a calibration is in progress: commit or cancel it first");
    if (!this.torque) throw new Refused("the arm is limp: switch the torque on first");
    const to = ARM_JOINTS.map((joint, index) => clampJoint(joint, target[index] ?? 0));
    this.move = { from: [...this.position], to, beganS: this.nowS, durationS: Math.max(0.1, durationS) };
    this.sent = this.move;
  }

  /** A move that was commanded just now and not yet published; null without one. */
  takeSent(): { to: readonly number[]; durationS: number } | null {
    const { sent } = this;
    this.sent = null;
    return sent !== null && this.nowS - sent.beganS < PUBLISHED_WITHIN_S ? sent : null;
  }

  moveGripper(angleRad: number): void {
    this.gripperTarget = Math.min(GRIPPER.closedRad, Math.max(GRIPPER.openRad, angleRad));
  }

  /** Hold the present pose. */
  stop(): void {
    this.move = null;
    this.gripperTarget = this.gripper;
    this.velocity = [0, 0, 0, 0];
  }

  advance(nowS: number, stepS: number): void {
    this.nowS = nowS;
    const way = Math.sign(this.gripperTarget - this.gripper) * GRIPPER_RAD_S * stepS;
    this.gripper = Math.abs(way) >= Math.abs(this.gripperTarget - this.gripper) ? this.gripperTarget : this.gripper + way;
    if (this.move === null) return;
    const { from, to, beganS, durationS } = this.move;
    const share = Math.min(1, (nowS - beganS) / durationS);
    const eased = share * share * (3 - 2 * share);
    const before = this.position;
    this.position = from.map((start, index) => start + ((to[index] ?? start) - start) * eased);
    this.velocity = this.position.map((value, index) => (stepS > 0 ? (value - (before[index] ?? value)) / stepS : 0));
    if (share >= 1) {
      this.move = null;
      this.velocity = [0, 0, 0, 0];
    }
  }

  calibrate(action: string): Calibration {
    const empty = { joints: [], offsets: [], diffs: [] };
    switch (action) {
      case "start":
        if (this.calibration !== "IDLE") throw new Refused("a calibration is in progress: commit or cancel it first");
        this.stop();
        this.torque = false;
        this.calibration = "AWAITING_POSE";
        return { state: this.calibration, message: "the arm is limp: pose it by hand with every joint at zero, then commit", ...empty };
      case "commit": {
        if (this.calibration !== "AWAITING_POSE") throw new Refused("nothing to commit: start first, and pose the arm by hand");
        this.endCalibration();
        const offsets = OBSERVED_TICKS.map((ticks) => (Math.abs(ticks) > WRITTEN_FROM_TICKS ? ticks : 0));
        const message = CALIBRATED.map((joint, index) => `${joint}: ${offsets[index] === 0 ? "kept" : "corrected"}`).join("; ");
        return { state: this.calibration, message, joints: [...CALIBRATED], offsets, diffs: [...OBSERVED_TICKS] };
      }
      case "cancel": {
        const message = this.calibration === "IDLE" ? "no calibration is in progress" : "canceled; the offsets are as they were";
        this.endCalibration();
        return { state: this.calibration, message, ...empty };
      }
      case "status": {
        const message = this.calibration === "IDLE" ? "no calibration is in progress" : "pose the arm by hand, then commit";
        return { state: this.calibration, message, ...empty };
      }
      default:
        throw new Refused(`action is '${action}', expected one of start, commit, cancel, status`);
    }
  }

  private endCalibration(): void {
    this.calibration = "IDLE";
    this.torque = true;
  }
}

function clampJoint(joint: (typeof ARM_JOINTS)[number], angleRad: number): number {
  const { lowerDeg, upperDeg } = JOINT_LIMITS[joint];
  return Math.min((upperDeg * Math.PI) / 180, Math.max((lowerDeg * Math.PI) / 180, angleRad));
}
