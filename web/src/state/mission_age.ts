/** How old the mission's state may be, and what it says of now. */
import type { lupin_msgs_MissionState } from "@/generated/messages";
import type { Sample } from "@/ros/topics";
import { isActive } from "./sentence";

/** The mission's state comes five times a second; older than this, it says nothing about now. */
export const MISSION_STALE_MS = 3000;

/** The mission's state where it is of now; null where there is none, or where it is out of date. */
export function currentMission(sample: Sample<lupin_msgs_MissionState> | undefined, nowMs: number): lupin_msgs_MissionState | null {
  return sample !== undefined && nowMs - sample.receivedMs <= MISSION_STALE_MS ? sample.message : null;
}

/** Whether a mission moves the robot now, as far as is known. */
export function missionDrivesAt(sample: Sample<lupin_msgs_MissionState> | undefined, nowMs: number): boolean {
  const mission = currentMission(sample, nowMs);
  return isActive(mission) && mission?.paused !== true;
}
