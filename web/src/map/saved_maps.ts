/** The maps that the console has saved, and when they can be loaded and deleted: as the console will judge it. */
import type { TextKey } from "@/i18n/text";
import { ACTIVE_STATES } from "@/state/sentence";
import type { MissionFacts } from "./mission_rules";

export interface SavedMap {
  name: string;
  /** Unix time. */
  saved_s: number;
  /** SLAM can go on in it: its pose graph was saved, too. */
  loadable: boolean;
  /** For a terminal of the console's computer; null without the map's YAML. */
  command: string | null;
}

export interface SavedMaps {
  folder: string;
  /** The one that this run uses. */
  loaded: string | null;
  maps: SavedMap[];
}

type Facts = Pick<MissionFacts, "linkOpen" | "isViewer" | "isWatching" | "isHeldByOther"> & {
  mission: { lifecycle_state: string } | null;
  navigates: boolean;
};

function changeObstacle({ linkOpen, isViewer, isWatching, isHeldByOther }: Facts): TextKey | null {
  if (!linkOpen) return "mission_no_link";
  if (isViewer) return "mission_viewer";
  if (isWatching) return "why_other_tab";
  return isHeldByOther ? "mission_held" : null;
}

/** Why a map cannot be loaded: what drives by the present one would drive elsewhere. */
export function loadObstacle(map: SavedMap, facts: Facts): TextKey | null {
  if (!map.loadable) return "map_not_loadable";
  const isInMission = facts.mission !== null && (ACTIVE_STATES as readonly string[]).includes(facts.mission.lifecycle_state);
  return changeObstacle(facts) ?? (isInMission ? "mission_running" : facts.navigates ? "map_goal_running" : null);
}

export function deleteObstacle(map: SavedMap, loaded: string | null, facts: Facts): TextKey | null {
  return map.name === loaded ? "map_is_loaded" : changeObstacle(facts);
}
