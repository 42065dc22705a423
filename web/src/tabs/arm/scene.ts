/**
 * The robot as flat faces, seen by an orthographic camera: a centimeter is a centimeter in every view. Faces are sorted from
 * far to near and painted over each other, which is enough for bodies that do not intersect.
 */
import { BODIES, type Shape } from "@/robot/model";
import { IDENTITY, type Transform, type Vector, chain, rotate, transformPoint } from "@/ros/tf";
import type { Angles } from "./joints";
import { armPoses } from "./kinematics";

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

export type Projection = (point: Vector) => Projected;

export function projection({ yawDeg, pitchDeg }: Camera): Projection {
  const [yaw, pitch] = [(yawDeg * Math.PI) / 180, (pitchDeg * Math.PI) / 180];
  const [cosYaw, sinYaw, cosPitch, sinPitch] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  return ({ x, y, z }) => {
    const away = x * sinYaw + y * cosYaw;
    return { x: x * cosYaw - y * sinYaw, y: z * cosPitch + away * sinPitch, depth: z * sinPitch - away * cosPitch };
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
/** Of length 1. */
const LIGHT: Vector = { x: 0.35, y: -0.55, z: 0.758 };
/** Small parts that are not needed to show the arm's pose. */
const LEFT_OUT = /^(led\d|pillar\d|lens)/;

/** The faces that the camera sees, the farthest first. */
export function visibleFaces(angles: Angles, camera: Camera): Face[] {
  const project = projection(camera);
  const poses = armPoses(angles);
  const faces: Face[] = [];
  for (const body of BODIES) {
    const pose = poses.get(body.name) ?? IDENTITY;
    for (const shape of body.shapes) {
      if (!LEFT_OUT.test(shape.name)) addFaces(faces, shape, chain(pose, shape.pose), project, body.parent !== "");
    }
  }
  return faces.toSorted((a, b) => a.depth - b.depth);
}

function addFaces(faces: Face[], shape: Shape, pose: Transform, project: Projection, isArm: boolean): void {
  const toViewer = (normal: Vector) => project(normal).depth;
  for (const { corners, normal, isSmooth = false } of shape.kind === "box" ? boxFaces(shape.size) : cylinderFaces(shape.size)) {
    const turned = rotate(pose.rotation, normal);
    if (toViewer(turned) <= 1e-6) continue;
    const outline = corners.map((corner) => project(transformPoint(pose, corner)));
    const depth = outline.reduce((sum, point) => sum + point.depth, 0) / outline.length;
    const light = 0.5 + 0.5 * (turned.x * LIGHT.x + turned.y * LIGHT.y + turned.z * LIGHT.z);
    faces.push({ outline, light, depth, isArm, isSmooth });
  }
}

interface FlatFace {
  corners: Vector[];
  normal: Vector;
  isSmooth?: boolean;
}

const at = (x: number, y: number, z: number): Vector => ({ x, y, z });

function boxFaces({ x, y, z }: Vector): FlatFace[] {
  const square = [
    [-1, -1],
    [1, -1],
    [1, 1],
    [-1, 1],
  ] as const;
  return [-1, 1].flatMap((side) => [
    { normal: at(side, 0, 0), corners: square.map(([a, b]) => at(side * x, a * y, b * z)) },
    { normal: at(0, side, 0), corners: square.map(([a, b]) => at(a * x, side * y, b * z)) },
    { normal: at(0, 0, side), corners: square.map(([a, b]) => at(a * x, b * y, side * z)) },
  ]);
}

function cylinderFaces({ x: radius, y: half }: Vector): FlatFace[] {
  const angle = (index: number) => (index * 2 * Math.PI) / CYLINDER_SIDES;
  const rim = (index: number, z: number) => at(radius * Math.cos(angle(index)), radius * Math.sin(angle(index)), z);
  const indices = Array.from({ length: CYLINDER_SIDES }, (_, index) => index);
  const sides = indices.map((index): FlatFace => {
    const middle = angle(index + 0.5);
    return {
      isSmooth: true,
      normal: at(Math.cos(middle), Math.sin(middle), 0),
      corners: [rim(index, -half), rim(index + 1, -half), rim(index + 1, half), rim(index, half)],
    };
  });
  const caps = [-1, 1].map((side): FlatFace => ({ normal: at(0, 0, side), corners: indices.map((index) => rim(index, side * half)) }));
  return [...sides, ...caps];
}
