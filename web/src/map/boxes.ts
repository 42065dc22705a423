/** The boxes of plants that the operator measured: rectangles on the map. */
import type { Point } from "./view";

export interface Box {
  id: string;
  /** Its four corners: front left, front right, back right, back left, as the front looks. */
  corners: [Point, Point, Point, Point];
  heightM: number;
}

/** The boxes of a message; what is malformed is passed over. */
export function readBoxes(text: string): Box[] {
  let parsed: unknown;
  try {
    parsed = JSON.parse(text);
  } catch {
    return [];
  }
  const list = Array.isArray(parsed) ? parsed : isObject(parsed) ? parsed["boxes"] : null;
  return Array.isArray(list) ? list.flatMap(readBox) : [];
}

function isObject(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null;
}

function readBox(value: unknown): Box[] {
  if (!isObject(value)) return [];
  const id = value["id"] ?? value["box_id"];
  const [x, y, yaw, width, depth] = ["x", "y", "yaw", "width", "depth"].map((name) => Number(value[name] ?? NaN)) as [
    number,
    number,
    number,
    number,
    number,
  ];
  if ((typeof id !== "string" && typeof id !== "number") || ![x, y, yaw].every(Number.isFinite) || !(width > 0 && depth > 0)) return [];
  const cos = Math.cos(yaw);
  const sin = Math.sin(yaw);
  const corner = (ahead: number, aside: number): Point => ({ x: x + cos * ahead - sin * aside, y: y + sin * ahead + cos * aside });
  const height = Number(value["height"] ?? NaN);
  return [
    {
      id: String(id),
      corners: [
        corner(depth / 2, width / 2),
        corner(depth / 2, -width / 2),
        corner(-depth / 2, -width / 2),
        corner(-depth / 2, width / 2),
      ],
      heightM: height > 0 && Number.isFinite(height) ? height : 0,
    },
  ];
}
