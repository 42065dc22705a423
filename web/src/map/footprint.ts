/** The robot's outline from above. */
import { BODIES, type Shape } from "@/generated/robot_model";
import { type Pose2, compose } from "@/ros/tf";
import type { Point } from "./view";

/** Half of a shape's extent along the axes of its body: boxes have half sizes, cylinders a radius and half a length along z. */
export function halfExtents(shape: Shape): [number, number, number] {
  const [a = 0, b = 0, c = 0] = shape.size;
  const half: [number, number, number] = shape.kind === "box" ? [a, b, c] : [a, a, b];
  const [x = 0, y = 0, z = 0, w = 1] = shape.turned;
  // The rotation matrix's absolute values turn half sizes into half extents.
  const rows = [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
  return rows.map((row) => row.reduce((sum, value, axis) => sum + Math.abs(value) * (half[axis] ?? 0), 0)) as [number, number, number];
}

export interface Outline {
  minX: number;
  maxX: number;
  minY: number;
  maxY: number;
}

function outlineOf(shapes: readonly Shape[]): Outline {
  const outline = { minX: Infinity, maxX: -Infinity, minY: Infinity, maxY: -Infinity };
  for (const shape of shapes) {
    const [halfX, halfY] = halfExtents(shape);
    const [x = 0, y = 0] = shape.at;
    outline.minX = Math.min(outline.minX, x - halfX);
    outline.maxX = Math.max(outline.maxX, x + halfX);
    outline.minY = Math.min(outline.minY, y - halfY);
    outline.maxY = Math.max(outline.maxY, y + halfY);
  }
  return outline;
}

const BASE_SHAPES = BODIES.find((body) => body.parent === "")?.shapes ?? [];

/** The rectangle around the robot's base with its wheels, m in its own frame. */
export const BASE: Outline = outlineOf(BASE_SHAPES);
/** The rectangles of its wheels. */
export const WHEELS: readonly Outline[] = BASE_SHAPES.filter((shape) => /_wheel$/.test(shape.name)).map((shape) => outlineOf([shape]));
/** The rectangle of its chassis. */
export const CHASSIS: Outline = outlineOf(BASE_SHAPES.filter((shape) => shape.name === "chassis"));

/** The corners of an outline for a robot at `pose`: front left, front right, rear right, rear left. */
export function cornersAt(outline: Outline, pose: Pose2): [Point, Point, Point, Point] {
  const place = (x: number, y: number): Point => compose(pose, { x, y, yaw: 0 });
  return [
    place(outline.maxX, outline.maxY),
    place(outline.maxX, outline.minY),
    place(outline.minX, outline.minY),
    place(outline.minX, outline.maxY),
  ];
}
