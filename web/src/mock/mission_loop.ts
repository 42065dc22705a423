/** The made-up mission: a loop of 50 s over four tags. */
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

/** Half the figure eight is driven in every loop, so that the robot is back in the middle at its end. */
const DRIVEN_S = TAGS_PER_MISSION * NAVIGATING_S + RETURNING_S;
const FIGURE_PER_S = FIGURE_PERIOD_S / 2 / DRIVEN_S;

export type LoopPhase = "ready" | "localizing" | "navigating" | "scanning" | "publishing" | "returning" | "done";

export interface LoopState {
  /** How many loops were completed before this one. */
  loop: number;
  phase: LoopPhase;
  /** The tag's place in the mission's order; how many are behind the robot while there is none. */
  tag: number;
  /** Where on the figure eight the robot is, s. */
  figureS: number;
  /** The share of this phase that is over. */
  share: number;
}

/** The state of the loop after `timeS` of mission time. */
export function loopState(timeS: number): LoopState {
  const loop = Math.floor(timeS / LOOP_S);
  const within = timeS - loop * LOOP_S;
  const base = (loop * FIGURE_PERIOD_S) / 2;
  const figureS = (drivenS: number) => base + drivenS * FIGURE_PER_S;
  if (within < READY_S) return { loop, phase: "ready", tag: 0, figureS: figureS(0), share: within / READY_S };
  if (within < FIRST_TAG_S) {
    return { loop, phase: "localizing", tag: 0, figureS: figureS(0), share: (within - READY_S) / LOCALIZING_S };
  }
  if (within < RETURN_BEGIN_S) {
    const tag = Math.floor((within - FIRST_TAG_S) / TAG_S);
    const since = within - FIRST_TAG_S - tag * TAG_S;
    const driven = figureS(tag * NAVIGATING_S + Math.min(since, NAVIGATING_S));
    if (since < NAVIGATING_S) return { loop, phase: "navigating", tag, figureS: driven, share: since / NAVIGATING_S };
    if (since < NAVIGATING_S + SCANNING_S) {
      return { loop, phase: "scanning", tag, figureS: driven, share: (since - NAVIGATING_S) / SCANNING_S };
    }
    return { loop, phase: "publishing", tag, figureS: driven, share: (since - NAVIGATING_S - SCANNING_S) / PUBLISHING_S };
  }
  if (within < DONE_BEGIN_S) {
    const since = within - RETURN_BEGIN_S;
    const driven = figureS(TAGS_PER_MISSION * NAVIGATING_S + since);
    return { loop, phase: "returning", tag: TAGS_PER_MISSION, figureS: driven, share: since / RETURNING_S };
  }
  return { loop, phase: "done", tag: TAGS_PER_MISSION, figureS: figureS(DRIVEN_S), share: (within - DONE_BEGIN_S) / DONE_S };
}

/** The mission time at which a tag's leg begins in a loop; the return, for the number of tags. */
export function legBeginS(loop: number, tag: number): number {
  return loop * LOOP_S + FIRST_TAG_S + Math.min(tag, TAGS_PER_MISSION) * TAG_S;
}

/** Where on the figure eight the robot stands before a tag of a loop, s. */
export function figureAtTag(loop: number, tag: number): number {
  return (loop * FIGURE_PERIOD_S) / 2 + (tag + 1) * NAVIGATING_S * FIGURE_PER_S;
}
