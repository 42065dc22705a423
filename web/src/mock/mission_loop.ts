/** Mock mission: a loop of 50 s over four tags. Times are seconds; the figure eight's time parameter is called figure time. */
import { FIGURE_PERIOD_S } from "./figure_eight";

export const READY_S = 4;
export const LOCALIZING_S = 3;
export const NAVIGATING_S = 5;
export const SCANNING_S = 3;
export const PUBLISHING_S = 1;
export const RETURNING_S = 4;
export const DONE_S = 3;
export const TAGS_PER_MISSION = 4;

export const TAG_S = NAVIGATING_S + SCANNING_S + PUBLISHING_S;
const FIRST_TAG_S = READY_S + LOCALIZING_S;
export const RETURN_BEGIN_S = FIRST_TAG_S + TAGS_PER_MISSION * TAG_S;
const DONE_BEGIN_S = RETURN_BEGIN_S + RETURNING_S;
export const LOOP_S = DONE_BEGIN_S + DONE_S;

/** Every loop drives half of the figure eight, so that the robot is back in the middle when the loop ends. */
const DRIVEN_S = TAGS_PER_MISSION * NAVIGATING_S + RETURNING_S;
/** Figure time per second of driving. */
const FIGURE_S_PER_DRIVEN_S = FIGURE_PERIOD_S / 2 / DRIVEN_S;

export type LoopPhase = "ready" | "localizing" | "navigating" | "scanning" | "publishing" | "returning" | "done";

export interface LoopState {
  /** How many loops were completed before this one. */
  loop: number;
  phase: LoopPhase;
  /** Index of the current tag in the mission's order: 0 before the first, TAGS_PER_MISSION when returning or done. */
  tag: number;
  /** The robot's position on the figure eight, as figure time. */
  figureS: number;
  /** Elapsed fraction of the phase, 0 to 1. */
  progress: number;
}

/** The state of the loop after `timeS` of mission time. */
export function loopState(timeS: number): LoopState {
  const loop = Math.floor(timeS / LOOP_S);
  const loopTimeS = timeS - loop * LOOP_S;
  const baseS = (loop * FIGURE_PERIOD_S) / 2;
  const figureS = (drivenS: number) => baseS + drivenS * FIGURE_S_PER_DRIVEN_S;
  if (loopTimeS < READY_S) return { loop, phase: "ready", tag: 0, figureS: figureS(0), progress: loopTimeS / READY_S };
  if (loopTimeS < FIRST_TAG_S) {
    return { loop, phase: "localizing", tag: 0, figureS: figureS(0), progress: (loopTimeS - READY_S) / LOCALIZING_S };
  }
  if (loopTimeS < RETURN_BEGIN_S) {
    const tag = Math.floor((loopTimeS - FIRST_TAG_S) / TAG_S);
    const legTimeS = loopTimeS - FIRST_TAG_S - tag * TAG_S;
    const positionS = figureS(tag * NAVIGATING_S + Math.min(legTimeS, NAVIGATING_S));
    if (legTimeS < NAVIGATING_S) return { loop, phase: "navigating", tag, figureS: positionS, progress: legTimeS / NAVIGATING_S };
    if (legTimeS < NAVIGATING_S + SCANNING_S) {
      return { loop, phase: "scanning", tag, figureS: positionS, progress: (legTimeS - NAVIGATING_S) / SCANNING_S };
    }
    return { loop, phase: "publishing", tag, figureS: positionS, progress: (legTimeS - NAVIGATING_S - SCANNING_S) / PUBLISHING_S };
  }
  if (loopTimeS < DONE_BEGIN_S) {
    const legTimeS = loopTimeS - RETURN_BEGIN_S;
    const positionS = figureS(TAGS_PER_MISSION * NAVIGATING_S + legTimeS);
    return { loop, phase: "returning", tag: TAGS_PER_MISSION, figureS: positionS, progress: legTimeS / RETURNING_S };
  }
  return { loop, phase: "done", tag: TAGS_PER_MISSION, figureS: figureS(DRIVEN_S), progress: (loopTimeS - DONE_BEGIN_S) / DONE_S };
}

/** The mission time at which the leg to a tag begins in a loop; for `tag` = TAGS_PER_MISSION, at which the return begins. */
export function legBeginS(loop: number, tag: number): number {
  return loop * LOOP_S + FIRST_TAG_S + Math.min(tag, TAGS_PER_MISSION) * TAG_S;
}

/** The figure time at which the robot stands in front of a tag of a loop. */
export function figureAtTagS(loop: number, tag: number): number {
  return (loop * FIGURE_PERIOD_S) / 2 + (tag + 1) * NAVIGATING_S * FIGURE_S_PER_DRIVEN_S;
}
