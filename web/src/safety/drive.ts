/** The only path by which this page commands a velocity. */
import { DRIVE } from "@/generated/robot";
import { type EndTimer, every } from "./timers";

export interface Velocity {
  /** Forward, m/s. */
  x: number;
  /** Left, m/s. */
  y: number;
  /** Counter-clockwise, rad/s. */
  yaw: number;
}

export const ZERO: Velocity = { x: 0, y: 0, yaw: 0 };
export const PERIOD_MS = 50;

export type Blocker = "no-link" | "stopped" | "no-control" | "other-tab" | "viewer" | "rewound";

export function clampVelocity(velocity: Velocity): Velocity {
  if (![velocity.x, velocity.y, velocity.yaw].every(Number.isFinite)) return ZERO;
  const fastest = Math.max(Math.abs(velocity.x), Math.abs(velocity.y));
  const scale = fastest > DRIVE.maxLinearMps ? DRIVE.maxLinearMps / fastest : 1;
  return {
    x: velocity.x * scale,
    y: velocity.y * scale,
    yaw: Math.max(-DRIVE.maxAngularRps, Math.min(DRIVE.maxAngularRps, velocity.yaw)),
  };
}

export function isZero(velocity: Velocity): boolean {
  return velocity.x === 0 && velocity.y === 0 && velocity.yaw === 0;
}

/** What commands a velocity: of several that are held at once, the velocities are added. */
export type DriveSource = "left-stick" | "right-stick" | "keyboard" | "gamepad" | "voice";

/**
 * Sends the velocity that is held, 20 times a second, and one zero when everything is let go. The speed limit is applied to each
 * sending, so that lowering it slows down what is held already.
 *
 * After a blocker has ended, each source must rest before it drives again: a stick that was held through a stop stays dead.
 */
export class Driver {
  private held = new Map<DriveSource, Velocity>();
  private dead = new Set<DriveSource>();
  private endTimer: EndTimer | undefined;

  constructor(
    private readonly send: (velocity: Velocity) => void,
    private readonly blocker: () => Blocker | null,
    private readonly changed: (velocity: Velocity, blocker: Blocker | null) => void = () => {},
    /** The speed limit, as a share of what the robot allows. */
    private readonly limit: () => number = () => 1,
  ) {}

  /** The velocity that a source asks for, before the speed limit. */
  hold(source: DriveSource, velocity: Velocity): void {
    const clamped = clampVelocity(velocity);
    if (isZero(clamped)) {
      this.dead.delete(source);
      if (this.held.delete(source)) this.step();
      if (this.held.size === 0) this.rest();
      return;
    }
    if (this.blocker() !== null) this.dead.add(source);
    this.held.set(source, clamped);
    if (this.endTimer === undefined) {
      this.endTimer = every(PERIOD_MS, () => this.step());
      this.step();
    }
  }

  /** What a source does while the robot may not be driven: it stays dead until it was at rest. */
  refuse(source: DriveSource, velocity: Velocity): void {
    this.hold(source, ZERO);
    if (!isZero(clampVelocity(velocity))) this.dead.add(source);
  }

  /** Let go of everything. */
  letGo(): void {
    for (const source of this.held.keys()) this.dead.add(source);
    this.held.clear();
    this.step();
    this.rest();
  }

  /** What is commanded now. */
  get velocity(): Velocity {
    if (this.blocker() !== null) return ZERO;
    const sum = { x: 0, y: 0, yaw: 0 };
    for (const [source, velocity] of this.held) {
      if (this.dead.has(source)) continue;
      sum.x += velocity.x;
      sum.y += velocity.y;
      sum.yaw += velocity.yaw;
    }
    const limit = this.limit();
    const { x, y, yaw } = clampVelocity(sum);
    return clampVelocity({ x: x * limit, y: y * limit, yaw: yaw * limit });
  }

  private step(): void {
    const blocker = this.blocker();
    if (blocker !== null) {
      for (const source of this.held.keys()) this.dead.add(source);
      this.changed(ZERO, blocker);
      return;
    }
    const velocity = this.velocity;
    this.send(velocity);
    this.changed(velocity, null);
  }

  private rest(): void {
    this.endTimer?.();
    this.endTimer = undefined;
  }
}
