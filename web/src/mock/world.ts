/** The mock robot in its greenhouse: where it is, what moves it, and what it has read. */
import { DRIVE, OUTER_RADIUS_M } from "@/generated/robot";
import { type Pose2, compose, wrapAngle } from "@/ros/tf";
import type { Velocity } from "@/safety/drive";
import { MockArm } from "./arm";
import { MockArmLibrary } from "./arm_library";
import { FIGURE_PERIOD_S, figureEight } from "./figure_eight";
import { FREE, TAGS, cellAt } from "./greenhouse";
import { MockMission } from "./mission";
import { figureAtTagS } from "./mission_loop";
import type { MockOptions } from "./options";

const STILL: Velocity = { x: 0, y: 0, yaw: 0 };
const GOAL_SPEED_MPS = 0.4;
const TURN_RPS = 1.4;
const ARRIVED_M = 0.04;
const ARRIVED_RAD = 0.05;
const EXECUTING = 2;
const SKEW_S = 1000;
const ASTRAY_AFTER_S = 2;
/** The robot's fixed clock in screenshots, which must be reproducible. */
const FROZEN_EPOCH_S = 1_795_600_000;
/** In the middle of the third tag's leg. */
const MISSION_START_S = 27.4;

export type Winner = "joy" | "manual" | "auto" | "zero" | null;

export interface Goal {
  pose: Pose2;
  /** Called once at its end: 4 succeeded, 5 canceled, 6 aborted. */
  ended: (status: number) => void;
}

export class World {
  timeS = 0;
  pose: Pose2;
  /** In the robot's frame. */
  velocity: Velocity = STILL;
  winner: Winner = null;
  goal: Goal | null = null;
  /** Every goal that was sent, with its status as in action_msgs/GoalStatus. */
  readonly goals: { stampS: number; status: number }[] = [];
  readonly arm = new MockArm();
  readonly library = new MockArmLibrary(this.arm);
  readonly mission: MockMission;
  /** Why the robot is stopped; kept by the console. */
  stopReasons: readonly string[] = [];
  /** When each tag was read last, in time of this world. */
  readonly readS = new Map(TAGS.map((tag) => [tag.id, -tag.ageS]));
  private manual: { velocity: Velocity; atS: number } | null = null;
  private readonly epochS: number;
  private readonly frozen: boolean;

  constructor(readonly options: MockOptions) {
    const loops = options.state === "live" || options.state === "mission";
    const startS = options.state === "mission" || options.state === "lost" ? MISSION_START_S : 0;
    this.mission = new MockMission(loops || options.state === "lost", startS);
    this.frozen = options.clockS !== null;
    this.epochS = this.frozen ? FROZEN_EPOCH_S : Date.now() / 1000;
    if (options.faults.has("skew")) this.epochS -= SKEW_S;
    this.pose = figureEight(this.mission.loop.figureS);
    this.pose = { ...this.pose, yaw: this.wantedYaw() };
    if (options.clockS !== null) for (let passed = 0; passed < options.clockS; passed += 0.05) this.step(0.05);
  }

  get isStopped(): boolean {
    return this.stopReasons.length > 0;
  }

  /** The robot's clock, s. */
  get clockS(): number {
    return this.epochS + this.timeS;
  }

  /** Whether the localization has lost the robot, so that a mission waits. */
  get isAstray(): boolean {
    return this.options.faults.has("astray") && this.timeS > ASTRAY_AFTER_S;
  }

  /** Whether navigation has a goal, which the sticks outrank and do not end. */
  get navigates(): boolean {
    const { isRunning, paused, loop } = this.mission;
    const missionDrives = isRunning && !paused && !this.isAstray && (loop.phase === "navigating" || loop.phase === "returning");
    return !this.isStopped && (this.goal !== null || missionDrives);
  }

  get batteryFraction(): number {
    return Math.max(0, 0.78 - this.timeS / 12_000);
  }

  advance(stepS: number): void {
    if (!this.frozen) this.step(stepS);
  }

  /** Commands that come while the robot is stopped are dropped: after a release nothing moves until a new one. */
  driveByHand(velocity: Velocity): void {
    if (!this.isStopped) this.manual = { velocity, atS: this.timeS };
  }

  sendGoal(pose: Pose2, ended: (status: number) => void = () => {}): void {
    this.cancelGoal();
    const sent = { stampS: this.clockS, status: EXECUTING };
    this.goals.push(sent);
    const end = (status: number) => {
      sent.status = status;
      ended(status);
    };
    this.goal = { pose, ended: end };
  }

  cancelGoal(): void {
    this.goal?.ended(5);
    this.goal = null;
  }

  /** The robot is somewhere else than it thought. */
  relocate(pose: Pose2): void {
    this.cancelGoal();
    this.pose = { ...pose };
  }

  stopAll(): void {
    this.cancelGoal();
    this.mission.hold();
    this.arm.stop();
    this.manual = null;
  }

  /** Where the robot drives, from where it is. */
  path(): Pose2[] {
    if (this.goal !== null) return line(this.pose, this.goal.pose);
    const { phase, figureS, loop, tag } = this.mission.loop;
    if (this.mission.paused || (phase !== "navigating" && phase !== "returning")) return [];
    const endS = phase === "navigating" ? figureAtTagS(loop, tag) : ((loop + 1) * FIGURE_PERIOD_S) / 2;
    const points: Pose2[] = [{ ...this.pose }];
    for (let at = figureS + 0.2; at < endS; at += 0.2) points.push(figureEight(at));
    return [...points, figureEight(endS)];
  }

  private step(stepS: number): void {
    this.timeS += stepS;
    this.arm.advance(this.timeS, stepS);
    this.library.advance(this.timeS);
    const before = this.pose;
    this.winner = this.move(stepS);
    this.velocity = bodyVelocity(before, this.pose, stepS);
    const { target, loop } = this.mission;
    if (target !== null && loop.phase === "publishing") this.readS.set(target.id, this.timeS);
  }

  private move(stepS: number): Winner {
    if (this.isStopped) return null;
    const { manual } = this;
    if (manual !== null && this.timeS - manual.atS <= DRIVE.manualTimeoutS) {
      // Zero holds the wheels too, against everything of a lower priority.
      if (!isStill(manual.velocity)) this.moveBy(manual.velocity, stepS);
      return "manual";
    }
    if (this.goal !== null) {
      this.moveToGoal(this.goal, stepS);
      return "auto";
    }
    if (this.isAstray) return "zero";
    this.mission.advance(stepS);
    if (!this.mission.isRunning || this.mission.paused) return "zero";
    this.follow(figureEight(this.mission.loop.figureS), this.wantedYaw(), stepS, DRIVE.maxLinearMps);
    return this.navigates ? "auto" : "zero";
  }

  private moveBy(velocity: Velocity, stepS: number): void {
    const step = { x: velocity.x * stepS, y: velocity.y * stepS, yaw: velocity.yaw * stepS };
    const next = compose(this.pose, step);
    if (isFree(next)) this.pose = next;
    else this.pose = { ...this.pose, yaw: next.yaw };
  }

  private moveToGoal(goal: Goal, stepS: number): void {
    this.follow(goal.pose, goal.pose.yaw, stepS, GOAL_SPEED_MPS);
    const near = Math.hypot(goal.pose.x - this.pose.x, goal.pose.y - this.pose.y) < ARRIVED_M;
    if (near && Math.abs(wrapAngle(goal.pose.yaw - this.pose.yaw)) < ARRIVED_RAD) {
      this.goal = null;
      goal.ended(4);
    }
  }

  private follow(to: { x: number; y: number }, yaw: number, stepS: number, speedMps: number): void {
    const [dx, dy] = [to.x - this.pose.x, to.y - this.pose.y];
    const distance = Math.hypot(dx, dy);
    const fraction = distance === 0 ? 0 : Math.min(1, (speedMps * stepS) / distance);
    const turn = wrapAngle(yaw - this.pose.yaw);
    const turned = Math.sign(turn) * Math.min(Math.abs(turn), TURN_RPS * stepS);
    this.pose = { x: this.pose.x + fraction * dx, y: this.pose.y + fraction * dy, yaw: wrapAngle(this.pose.yaw + turned) };
  }

  /** Along the path while driving, and at the tag while reading it. */
  private wantedYaw(): number {
    const { phase, figureS, progress } = this.mission.loop;
    const { target } = this.mission;
    const tag = target?.index === null || target === null ? undefined : TAGS[target.index];
    const isNear = phase === "scanning" || phase === "publishing" || (phase === "navigating" && progress > 0.75);
    if (tag === undefined || !isNear) return figureEight(figureS).yaw;
    return Math.atan2(tag.pose.y - this.pose.y, tag.pose.x - this.pose.x);
  }
}

function isStill(velocity: Velocity): boolean {
  return velocity.x === 0 && velocity.y === 0 && velocity.yaw === 0;
}

function isFree({ x, y }: Pose2): boolean {
  for (let angle = 0; angle < 2 * Math.PI; angle += Math.PI / 4) {
    if (cellAt(x + OUTER_RADIUS_M * Math.cos(angle), y + OUTER_RADIUS_M * Math.sin(angle)) !== FREE) return false;
  }
  return true;
}

function bodyVelocity(before: Pose2, after: Pose2, stepS: number): Velocity {
  if (stepS <= 0) return STILL;
  const [dx, dy] = [(after.x - before.x) / stepS, (after.y - before.y) / stepS];
  const cos = Math.cos(after.yaw);
  const sin = Math.sin(after.yaw);
  return { x: cos * dx + sin * dy, y: -sin * dx + cos * dy, yaw: wrapAngle(after.yaw - before.yaw) / stepS };
}

/** A straight path with a pose every 10 cm. */
export function line(from: Pose2, to: Pose2): Pose2[] {
  const distance = Math.hypot(to.x - from.x, to.y - from.y);
  const count = Math.max(1, Math.ceil(distance / 0.1));
  const yaw = distance > 0.05 ? Math.atan2(to.y - from.y, to.x - from.x) : to.yaw;
  return Array.from({ length: count + 1 }, (_, index) => ({
    x: from.x + ((to.x - from.x) * index) / count,
    y: from.y + ((to.y - from.y) * index) / count,
    yaw: index === count ? to.yaw : yaw,
  }));
}
