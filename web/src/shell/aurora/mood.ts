/** The mood of the background: what it says of the robot, and how it gets from one to the next. */

export type Mood = "calm" | "mission" | "stopped" | "lost";

export interface MoodFacts {
  linkOpen: boolean;
  wasOpen: boolean;
  stopped: boolean;
  missionRuns: boolean;
}

export function moodOf({ linkOpen, wasOpen, stopped, missionRuns }: MoodFacts): Mood {
  if (!linkOpen) return wasOpen ? "lost" : "calm";
  if (stopped) return "stopped";
  return missionRuns ? "mission" : "calm";
}

/** What the shader draws a mood with, each from 0 to 1; `pace` is how fast it drifts. */
export interface Look {
  stop: number;
  lost: number;
  gain: number;
  pace: number;
}

export const LOOKS: Readonly<Record<Mood, Look>> = {
  calm: { stop: 0, lost: 0, gain: 0.34, pace: 0.5 },
  mission: { stop: 0, lost: 0, gain: 0.66, pace: 1 },
  stopped: { stop: 1, lost: 0, gain: 0.74, pace: 0.25 },
  lost: { stop: 0, lost: 1, gain: 0.42, pace: 0.15 },
};

/** How long a change of mood takes, to 63 %. */
const CHANGE_S = 0.7;

/** The look after `stepS` on the way to another. */
export function approach(now: Look, goal: Look, stepS: number): Look {
  const share = 1 - Math.exp(-Math.max(0, stepS) / CHANGE_S);
  const toward = (from: number, to: number) => from + (to - from) * share;
  return {
    stop: toward(now.stop, goal.stop),
    lost: toward(now.lost, goal.lost),
    gain: toward(now.gain, goal.gain),
    pace: toward(now.pace, goal.pace),
  };
}

/** Whether a look is as good as reached. */
export function isSettled(now: Look, goal: Look): boolean {
  return Math.abs(now.stop - goal.stop) + Math.abs(now.lost - goal.lost) + Math.abs(now.gain - goal.gain) < 0.02;
}
