/** Approaches of tags that the operator drew, for the file that `lupin up --overrides` reads. */
import { create } from "zustand";
import type { Pose2 } from "@/ros/tf";
import { useMapUi } from "./map_ui";
import { compareIds } from "./twin";

export const useApproaches = create<{ poses: Record<string, Pose2> }>(() => ({ poses: {} }));

export function keepApproach(tag: string, pose: Pose2): void {
  useApproaches.setState(({ poses }) => ({ poses: { ...poses, [tag]: pose } }));
  useMapUi.setState({ draft: null, tool: "move" });
}

export function removeApproach(tag: string): void {
  useApproaches.setState(({ poses }) => ({ poses: Object.fromEntries(Object.entries(poses).filter(([id]) => id !== tag)) }));
}

/** The file (CONTRACT 7.3). Ids are quoted as JSON strings, which YAML reads as well. */
export function overridesFile(poses: Readonly<Record<string, Pose2>>): string {
  const lines = Object.entries(poses)
    .toSorted(([a], [b]) => compareIds(a, b))
    .map(([tag, { x, y, yaw }]) => `  ${JSON.stringify(tag)}: {goal_x: ${x.toFixed(3)}, goal_y: ${y.toFixed(3)}, yaw: ${yaw.toFixed(4)}}\n`);
  return `overrides:\n${lines.join("")}`;
}
