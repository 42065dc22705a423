/** What the detectors see in the images: tags in the front camera's, flowers in the gripper camera's. */
import type { TextKey } from "@/i18n/text";

export type Point = readonly [x: number, y: number];

export interface TagDetection {
  id: string;
  /** Top left, top right, bottom right, bottom left, in pixels of the camera's image. */
  corners: Point[];
  distanceM: number | null;
}

export interface FlowerDetection {
  /** The detector's class, such as `tulip_red`. */
  name: string;
  certainty: number | null;
  /** Left, top, right, bottom in pixels of the camera's image; null where it is malformed. */
  box: readonly [number, number, number, number] | null;
}

/** The tags of a `/camera/tag_detections_json` message; what is malformed is left out. */
export function parseTags(text: string): TagDetection[] {
  return entriesOf(text).flatMap(({ id, corners, dist }): TagDetection[] => {
    if ((typeof id !== "number" && typeof id !== "string") || !isQuad(corners)) return [];
    return [{ id: String(id), corners, distanceM: finiteOrNull(dist) }];
  });
}

/** When the image of a message's detections was taken, s of ROS time; null where the message does not say. */
export function stampOf(text: string): number | null {
  return finiteOrNull(entriesOf(text)[0]?.["stamp"]);
}

/** The entries of a `/yolo/detections` message, the surest first; what is malformed is left out. */
export function parseFlowers(text: string): FlowerDetection[] {
  const found = entriesOf(text).map(({ class_name, confidence, bbox_xyxy }): FlowerDetection => ({
    name: typeof class_name === "string" ? class_name : "",
    certainty: finiteOrNull(confidence),
    box: isBox(bbox_xyxy) ? bbox_xyxy : null,
  }));
  return found.toSorted((a, b) => (b.certainty ?? 0) - (a.certainty ?? 0));
}

function entriesOf(text: string): Record<string, unknown>[] {
  let entries: unknown;
  try {
    entries = JSON.parse(text);
  } catch {
    return [];
  }
  if (!Array.isArray(entries)) return [];
  return entries.filter((entry): entry is Record<string, unknown> => typeof entry === "object" && entry !== null);
}

function isQuad(value: unknown): value is Point[] {
  return (
    Array.isArray(value) &&
    value.length === 4 &&
    value.every((corner: unknown) => Array.isArray(corner) && corner.length === 2 && corner.every((part) => Number.isFinite(part)))
  );
}

function isBox(value: unknown): value is [number, number, number, number] {
  return Array.isArray(value) && value.length === 4 && value.every((side) => Number.isFinite(side));
}

function finiteOrNull(value: unknown): number | null {
  return typeof value === "number" && Number.isFinite(value) ? value : null;
}

const NAMES: Record<string, TextKey> = {
  tulip_red: "cameras_tulip_red",
  tulip_white: "cameras_tulip_white",
  tulip_pink: "cameras_tulip_pink",
  bug: "cameras_bug",
};

/** The name of a detector's class in the catalog; null for one that it does not have. */
export function className(name: string): TextKey | null {
  return NAMES[name] ?? null;
}
