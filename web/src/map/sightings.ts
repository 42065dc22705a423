/** Observations of the last seconds, where they were made. */
import { type lupin_msgs_Observation, lupin_msgs_Observation as OBSERVATION } from "@/generated/messages";
import type { Point } from "./view";

/** How long a sighting is shown. */
export const SIGHTING_MS = 5000;

export interface Sighting extends Point {
  receivedMs: number;
}

/** Where an observation was made: at its tag, or at its flowers. null where it failed, or has no place. */
export function placeOf({ kind, status, tag_pose_in_map, flower }: lupin_msgs_Observation): Point | null {
  if (status !== OBSERVATION.STATUS_OK) return null;
  const poses = [tag_pose_in_map, ...(kind === OBSERVATION.KIND_FLOWER ? [flower.pose.pose] : [])];
  // A pose that was never set has no orientation.
  const pose = poses.find(({ position, orientation }) => orientation.w !== 0 && Number.isFinite(position.x) && Number.isFinite(position.y));
  return pose === undefined ? null : { x: pose.position.x, y: pose.position.y };
}

/** The sightings with another one; those that are no longer shown are dropped, and so is an earlier one of the same place. */
export function addSighting(sightings: readonly Sighting[], added: Sighting): Sighting[] {
  return [...shownSightings(sightings, added.receivedMs).filter(({ x, y }) => x !== added.x || y !== added.y), added];
}

/** Those that are still shown at a time. A sighting of later, as before a rewind, is not. */
export function shownSightings(sightings: readonly Sighting[], nowMs: number): Sighting[] {
  return sightings.filter(({ receivedMs }) => nowMs - receivedMs <= SIGHTING_MS && receivedMs <= nowMs);
}
