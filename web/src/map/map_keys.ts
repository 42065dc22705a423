import type { KeyboardEvent } from "react";
import { commandOf } from "./keys";
import { liveMap } from "./live_map";
import { chooseTool, draftSender, drawPose, dropDraft, useMapUi } from "./map_ui";
import type { Point } from "./view";

/** What the keys move, in either view. */
export interface KeyTarget {
  pan: (pixels: Point) => void;
  zoom: (factor: number) => void;
  center: () => Point;
  turned: boolean;
}

/** The attributes of what takes the keys of the map; `map-keys` is the text that explains them. */
export const MAP_SURFACE = { tabIndex: 0, "aria-describedby": "map-keys" } as const;

export function handleMapKey(event: KeyboardEvent, target: KeyTarget | null): void {
  if (target === null) return;
  const { draft, isFollowing, controls } = useMapUi.getState();
  const command = commandOf(event, draft?.pose ?? null, target.turned);
  if (command === null) return;
  event.preventDefault();
  event.stopPropagation();
  switch (command.do) {
    case "pan":
      useMapUi.setState({ isFollowing: false });
      target.pan(command);
      break;
    case "zoom":
      target.zoom(command.factor);
      break;
    case "fit":
      controls?.fit();
      break;
    case "follow":
      useMapUi.setState({ isFollowing: !isFollowing });
      break;
    case "goal":
      chooseTool("goal");
      drawPose({ kind: "goal", pose: { ...target.center(), yaw: liveMap.pose?.yaw ?? 0 } });
      break;
    case "draft":
      if (draft !== null) drawPose({ ...draft, pose: command.pose });
      break;
    case "send":
      if (draft?.kind === "goal") draftSender.send?.();
      break;
    case "cancel":
      dropDraft();
      break;
  }
}
