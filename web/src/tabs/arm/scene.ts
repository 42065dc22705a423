/**
 * The robot as flat faces, seen by an orthographic camera: a centimeter is a centimeter in every view. Faces are sorted from
 * far to near and painted over each other, which is enough for bodies that do not intersect.
 */
import { BODIES, type Shape } from "@/generated/robot_model";
import type { Angles } from "./joints";
import { type Frame, type Point, bodyFrames, compose, frameOf, rotate, transform } from "./kinematics";

export interface Camera {
  /** Degrees about the vertical: 0 looks from the robot's right side, with the front at the right. */
  yawDeg: number;
  /** Degrees above the horizon: 90 looks from above. */
  pitchDeg: number;
}

export const VIEWS = {
  side: { yawDeg: 0, pitchDeg: 0 },
  top: { yawDeg: 0, pitchDeg: 90 },
  free: { yawDeg: -28, pitchDeg: 22 },
} as const satisfies Record<string, Camera>;

export interface Projected {
  /** Right and up in the picture, m. */
  x: number;
  y: number;
  /** Towards the viewer, m. */
  depth: number;
}

export type Projection = (point: Point) => Projected;

export function projection({ yawDeg, pitchDeg }: Camera): Projection {
  const [yaw, pitch] = [(yawDeg * Math.PI) / 180, (pitchDeg * Math.PI) / 180];
  const [cosYaw, sinYaw, cosPitch, sinPitch] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  return ([px, py, pz]) => {
    const x = px * cosYaw - py * sinYaw;
    const away = px * sinYaw + py * cosYaw;
    return { x, y: pz * cosPitch + away * sinPitch, depth: pz * sinPitch - away * cosPitch };
  };
}

export interface Face {
  outline: Projected[];
  /** 0 in the shade to 1 in the light. */
  light: number;
  depth: number;
  isArm: boolean;
  /** Part of a round surface. */
  isSmooth: boolean;
}

const CYLINDER_SIDES = 20;
const LIGHT: Point = normalize([0.35, -0.55, 0.76]);
/** Small parts that are not needed to show the arm's pose. */
const LEFT_OUT = /^(led\d|pillar\d|lens)/;

/** The faces that the camera sees, the farthest first. */
export function visibleFaces(angles: Angles, camera: Camera): Face[] {
  const project = projection(camera);
  const frames = bodyFrames(angles);
  const faces: Face[] = [];
  for (const body of BODIES) {
    const frame = frames.get(body.name) ?? frameOf([], []);
    for (const shape of body.shapes) {
      if (!LEFT_OUT.test(shape.name)) addFaces(faces, shape, compose(frame, frameOf(shape.at, shape.turned)), project, body.parent !== "");
    }
  }
  return faces.toSorted((a, b) => a.depth - b.depth);
}

function addFaces(faces: Face[], shape: Shape, frame: Frame, project: Projection, isArm: boolean): void {
  const toViewer = (normal: Point) => project(normal).depth;
  for (const { corners, normal, isSmooth = false } of shape.kind === "box" ? boxFaces(shape.size) : cylinderFaces(shape.size)) {
    const turned = rotate(frame.turned, normal);
    if (toViewer(turned) <= 1e-6) continue;
    const outline = corners.map((corner) => project(transform(frame, corner)));
    const depth = outline.reduce((sum, point) => sum + point.depth, 0) / outline.length;
    const light = 0.5 + 0.5 * (turned[0] * LIGHT[0] + turned[1] * LIGHT[1] + turned[2] * LIGHT[2]);
    faces.push({ outline, light, depth, isArm, isSmooth });
  }
}

interface FlatFace {
  corners: Point[];
  normal: Point;
  isSmooth?: boolean;
}

/** `size`: half of the edge lengths. */
function boxFaces([x = 0, y = 0, z = 0]: readonly number[]): FlatFace[] {
  const square = [
    [-1, -1],
    [1, -1],
    [1, 1],
    [-1, 1],
  ] as const;
  return [-1, 1].flatMap((side) => [
    { normal: [side, 0, 0] as Point, corners: square.map(([a, b]): Point => [side * x, a * y, b * z]) },
    { normal: [0, side, 0] as Point, corners: square.map(([a, b]): Point => [a * x, side * y, b * z]) },
    { normal: [0, 0, side] as Point, corners: square.map(([a, b]): Point => [a * x, b * y, side * z]) },
  ]);
}

/** `size`: the radius and half of the height; the axis is z. */
function cylinderFaces([radius = 0, half = 0]: readonly number[]): FlatFace[] {
  const angle = (index: number) => (index * 2 * Math.PI) / CYLINDER_SIDES;
  const rim = (index: number, z: number): Point => [radius * Math.cos(angle(index)), radius * Math.sin(angle(index)), z];
  const indices = Array.from({ length: CYLINDER_SIDES }, (_, index) => index);
  const sides = indices.map((index): FlatFace => {
    const middle = angle(index + 0.5);
    return {
      isSmooth: true,
      normal: [Math.cos(middle), Math.sin(middle), 0],
      corners: [rim(index, -half), rim(index + 1, -half), rim(index + 1, half), rim(index, half)],
    };
  });
  const caps = [-1, 1].map((side): FlatFace => ({ normal: [0, 0, side], corners: indices.map((index) => rim(index, side * half)) }));
  return [...sides, ...caps];
}

function normalize([x, y, z]: Point): Point {
  const length = Math.hypot(x, y, z);
  return [x / length, y / length, z / length];
}
