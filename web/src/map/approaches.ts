/** Approaches of tags that operators drew: the run's mission takes them at its next visit of the tag. */
import { type Approach, useConsole } from "@/api/console_store";
import { postJson } from "@/api/http";
import type { Pose2 } from "@/ros/tf";
import { dropDraft } from "./map_ui";
import { compareIds } from "./twin";

/** Store the approach of a tag, or remove it. Throws ApiError with the server's reason. */
export async function changeApproach(tag: string, pose: Pose2 | null): Promise<void> {
  const approaches = await postJson<Record<string, Approach>>("/_api/approaches", { tag, pose });
  useConsole.setState({ approaches });
  if (pose !== null) dropDraft();
}

/** The pose of an approach; null if a part of it is left to be computed. */
export function approachPose(approach: Approach | undefined): Pose2 | null {
  const { goal_x: x, goal_y: y, yaw } = approach ?? {};
  return x === undefined || y === undefined || yaw === undefined ? null : { x, y, yaw };
}

/** The file that `lupin up --overrides` reads. Ids are quoted as JSON strings, which YAML reads as well. */
export function overridesFile(approaches: Readonly<Record<string, Approach>>): string {
  const lines = Object.entries(approaches)
    .toSorted(([a], [b]) => compareIds(a, b))
    .map(([tag, approach]) => {
      const values = (["goal_x", "goal_y", "yaw", "standoff"] as const).flatMap((key) => {
        const value = approach[key];
        return value === undefined ? [] : [`${key}: ${value.toFixed(4)}`];
      });
      return `  ${JSON.stringify(tag)}: {${values.join(", ")}}\n`;
    });
  return `overrides:\n${lines.join("")}`;
}
