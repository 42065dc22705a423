/** The robot's outline from above. */
import { type Pose2, compose, rotate } from "@/ros/tf";
import { BODIES, type Shape } from "./model";

export interface Outline {
  minX: number;
  maxX: number;
  minY: number;
  maxY: number;
}

/** Half of a shape's extent along the axes of its body. */
export function halfExtents({ kind, size, pose }: Shape): { x: number; y: number; z: number } {
  const [halfY, halfZ] = kind === "box" ? [size.y, size.z] : [size.x, size.y];
  const edges = [{ x: size.x, y: 0, z: 0 }, { x: 0, y: halfY, z: 0 }, { x: 0, y: 0, z: halfZ }].map((edge) => rotate(pose.rotation, edge));
  const along = (axis: "x" | "y" | "z") => edges.reduce((sum, edge) => sum + Math.abs(edge[axis]), 0);
  return { x: along("x"), y: along("y"), z: along("z") };
}

function outlineOf(shapes: readonly Shape[]): Outline {
  const outline = { minX: Infinity, maxX: -Infinity, minY: Infinity, maxY: -Infinity };
  for (const shape of shapes) {
    const half = halfExtents(shape);
    const { x, y } = shape.pose.translation;
    outline.minX = Math.min(outline.minX, x - half.x);
    outline.maxX = Math.max(outline.maxX, x + half.x);
    outline.minY = Math.min(outline.minY, y - half.y);
    outline.maxY = Math.max(outline.maxY, y + half.y);
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
export function cornersAt({ minX, maxX, minY, maxY }: Outline, pose: Pose2): [Pose2, Pose2, Pose2, Pose2] {
  const place = (x: number, y: number) => compose(pose, { x, y, yaw: 0 });
  return [place(maxX, maxY), place(maxX, minY), place(minX, minY), place(minX, maxY)];
}
