/** What the operator chose on the map: the view, the layer, the tool, and the pose that is being drawn. */
import { create } from "zustand";
import type { TextKey } from "@/i18n/text";
import { isRewound } from "@/state/rewind";
import type { Pose2 } from "@/ros/tf";
import { poseFromDrag } from "./goal";
import type { Sensor } from "./health";
import { liveMap } from "./live_map";
import type { Point } from "./view";

export type Tool = "move" | "goal" | "relocate" | "approach";

/** A pose on the map that was drawn but not sent. */
export interface Draft {
  kind: Exclude<Tool, "move">;
  pose: Pose2;
  /** The tag whose approach it is, or the name of the location that it came from. */
  name?: string;
}

/** The way to a drawn goal, as the robot's planner answered. */
export interface Preview {
  points: Point[];
  problem: TextKey | null;
  isPending: boolean;
}

/** What the shown view can do. */
export interface ViewControls {
  zoom: (factor: number) => void;
  fit: () => void;
  /** The point of the map in the middle of the view. */
  center: () => Point;
}

interface MapUi {
  mode: "2d" | "3d";
  layer: Sensor | null;
  isFollowing: boolean;
  tool: Tool;
  draft: Draft | null;
  preview: Preview | null;
  /** The last goal that was sent from here, and the ids of those that navigation knew then. */
  sent: { pose: Pose2; atMs: number; known: ReadonlySet<string> } | null;
  selected: string | null;
  controls: ViewControls | null;
}

export const useMapUi = create<MapUi>(() => ({
  mode: "2d",
  layer: null,
  isFollowing: false,
  tool: "move",
  draft: null,
  preview: null,
  sent: null,
  selected: null,
  controls: null,
}));

export function chooseTool(tool: Tool): void {
  if (isRewound()) return;
  useMapUi.setState((state) => ({ tool, draft: state.draft?.kind === tool ? state.draft : null, preview: null }));
}

export function drawPose(draft: Draft): void {
  if (isRewound()) return;
  useMapUi.setState({ draft, tool: draft.kind });
}

/** Draw the pose of a drag with the chosen tool. */
export function drawWithTool(from: Point, to: Point, isHeadingSet: boolean): void {
  const { tool, selected } = useMapUi.getState();
  if (tool === "move") return;
  const pose = poseFromDrag(from, to, isHeadingSet, liveMap.pose);
  drawPose({ kind: tool, pose, ...(tool === "approach" && selected !== null ? { name: selected } : {}) });
}

/** Sends the drawn pose; null while it may not be sent. Kept by what shows the pose with its obstacles. */
export const draftSender: { send: (() => void) | null } = { send: null };

export function dropDraft(): void {
  useMapUi.setState({ draft: null, preview: null, tool: "move" });
}

/** Select a tag, or none where it was selected already. */
export function toggleTag(id: string): void {
  useMapUi.setState((state) => ({ selected: state.selected === id ? null : id }));
}
