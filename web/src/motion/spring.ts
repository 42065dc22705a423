/**
 * Animates slow values, such as a battery's voltage: the shown value follows the actual one like a damped spring, then rests.
 *
 * One loop moves all springs. It runs only while one of them moves, so that a page whose data does not change draws
 * nothing. With reduced motion every value is shown at once.
 */
import { useEffect, useLayoutEffect, useRef } from "react";

/** Undamped angular frequency in rad/s; the spring is critically damped and arrives within about 0.35 s. */
const FREQUENCY = 18;
const LONGEST_STEP_S = 0.05;
/** Fraction of the distance; a value nearer to its target than this has arrived. */
const ARRIVED_SHARE = 0.002;

export interface SpringState {
  value: number;
  /** Per second. */
  speed: number;
}

/** The state of a critically damped spring after a time, by its exact solution: no step is too long for it. */
export function stepSpring({ value, speed }: SpringState, target: number, seconds: number): SpringState {
  const offset = value - target;
  const slope = speed + FREQUENCY * offset;
  const decay = Math.exp(-FREQUENCY * seconds);
  return { value: target + (offset + slope * seconds) * decay, speed: (speed - FREQUENCY * slope * seconds) * decay };
}

class Spring {
  private state: SpringState;
  private target: number;
  private way = 0;

  constructor(
    value: number,
    private readonly draw: (value: number) => void,
  ) {
    this.state = { value, speed: 0 };
    this.target = value;
    draw(value);
  }

  /** Move to a value. A value that is not a number, or that follows one, is shown at once. */
  moveTo(target: number): void {
    if (Object.is(target, this.target)) return;
    const jumps = !Number.isFinite(target) || !Number.isFinite(this.state.value) || prefersReducedMotion();
    this.target = target;
    this.way = Math.abs(target - this.state.value);
    if (jumps) this.arrive();
    else setMoving(this);
  }

  /** Take a step; returns whether the value has arrived. */
  step(seconds: number): boolean {
    this.state = stepSpring(this.state, this.target, seconds);
    const near = Math.abs(this.state.value - this.target) <= this.way * ARRIVED_SHARE;
    if (near) this.arrive();
    else this.draw(this.state.value);
    return near;
  }

  stop(): void {
    moving.delete(this);
  }

  private arrive(): void {
    moving.delete(this);
    this.state = { value: this.target, speed: 0 };
    this.draw(this.target);
  }
}

const moving = new Set<Spring>();
let frame = 0;
let lastMs = 0;

function setMoving(spring: Spring): void {
  moving.add(spring);
  if (frame !== 0) return;
  lastMs = performance.now();
  frame = requestAnimationFrame(stepAll);
}

function stepAll(nowMs: number): void {
  const seconds = Math.min(LONGEST_STEP_S, Math.max(0, (nowMs - lastMs) / 1000));
  lastMs = nowMs;
  for (const spring of [...moving]) spring.step(seconds);
  frame = moving.size > 0 ? requestAnimationFrame(stepAll) : 0;
}

/** Whether the operator asked their system for less motion. */
export function prefersReducedMotion(): boolean {
  return typeof window.matchMedia === "function" && window.matchMedia("(prefers-reduced-motion: reduce)").matches;
}

/** Call `draw` with a value that follows `target` on a spring. Null is drawn as NaN. Nothing is rendered by React. */
export function useSpring(target: number | null | undefined, draw: (value: number) => void): void {
  const spring = useRef<Spring | null>(null);
  const current = useRef(draw);
  const value = target ?? NaN;
  useLayoutEffect(() => {
    current.current = draw;
  });
  useLayoutEffect(() => {
    if (spring.current === null) spring.current = new Spring(value, (shown) => current.current(shown));
    else spring.current.moveTo(value);
  }, [value]);
  useEffect(
    () => () => {
      spring.current?.stop();
      spring.current = null;
    },
    [],
  );
}
