/** The only path by which this page commands a velocity. */
import { DRIVE } from "@/generated/robot";

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

export type Blocker = "no-link" | "stopped" | "no-control" | "viewer";

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

/** What commands a velocity: several of them may be held at once, and the last one that moved drives. */
export type DriveSource = "left-stick" | "right-stick" | "keyboard" | "gamepad" | "voice";

/**
 * Sends the velocity that is held, 20 times a second, and one zero when everything is let go.
 *
 * After a blocker has ended, each source must rest before it drives again: a stick that was held through a stop stays dead.
 */
export class Driver {
  private held = new Map<DriveSource, Velocity>();
  private dead = new Set<DriveSource>();
  private timer: ReturnType<typeof setInterval> | undefined;

  constructor(
    private readonly send: (velocity: Velocity) => void,
    private readonly blocker: () => Blocker | null,
    private readonly changed: (velocity: Velocity, blocker: Blocker | null) => void = () => {},
  ) {}

  /** The velocity that a source asks for. */
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
    if (this.timer === undefined) {
      this.timer = setInterval(() => this.step(), PERIOD_MS);
      this.step();
    }
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
    return clampVelocity(sum);
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
    clearInterval(this.timer);
    this.timer = undefined;
  }
}
