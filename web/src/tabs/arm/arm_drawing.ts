/** Draws the arm on a canvas: the measured pose as bodies, the commanded one as a dashed line over it, and labels. */
import { IDENTITY, type Vector } from "@/ros/tf";
import { cssColor, fitCanvas } from "@/widgets/canvas";
import type { Angles, JointName } from "./joints";
import { armPoses, skeleton } from "./kinematics";
import { type Camera, type Projected, projection, visibleFaces } from "./scene";

export interface JointLabel {
  joint: JointName;
  title: string;
  /** The commanded angle, or the joint's phase. */
  note: string;
  tone: "calm" | "moving" | "attention" | "lost";
}

export interface Picture {
  camera: Camera;
  /** Empty if no pose was measured; the arm is then not drawn. */
  measured: Angles;
  /** Null if it equals the measured pose. */
  commanded: Angles | null;
  isStale: boolean;
  labels: readonly JointLabel[];
}

interface Screen {
  context: CanvasRenderingContext2D;
  onScreen: (point: Projected) => [x: number, y: number];
  at: (point: Vector) => [x: number, y: number];
}

/** The drawing shows the half sphere that the arm can reach, and below it the chassis. */
const SHOULDER = (armPoses({}).get("shoulder_lift") ?? IDENTITY).translation;
const REACH_M = 0.43;
const CHASSIS_BELOW_M = 0.22;
/** Half of the floor's edge; its lines are 0.1 m apart. */
const FLOOR_M = 1;
const LABELS_FROM_PX = 460;

export function drawArm(canvas: HTMLCanvasElement, picture: Picture): void {
  const drawing = fitCanvas(canvas);
  if (drawing === null) return;
  const { context, width, height } = drawing;
  const project = projection(picture.camera);
  const pitch = (picture.camera.pitchDeg * Math.PI) / 180;
  const belowM = CHASSIS_BELOW_M + (REACH_M - CHASSIS_BELOW_M) * Math.sin(pitch);
  const scale = Math.min(width / (2 * REACH_M), (height - 16) / (REACH_M + belowM));
  const center = project(SHOULDER);
  const middle: [number, number] = [width / 2, (height - (REACH_M + belowM) * scale) / 2 + REACH_M * scale];
  const onScreen = ({ x, y }: Projected): [number, number] => [middle[0] + (x - center.x) * scale, middle[1] - (y - center.y) * scale];
  const screen: Screen = { context, onScreen, at: (point) => onScreen(project(point)) };
  const isKnown = Object.keys(picture.measured).length > 0;
  context.clearRect(0, 0, width, height);
  context.lineJoin = context.lineCap = "round";
  drawFloor(screen, picture.camera.pitchDeg < 3);
  drawBodies(screen, picture, isKnown);
  if (!isKnown) return;
  if (picture.commanded !== null) drawGhost(screen, picture.commanded);
  drawLabels(screen, picture, width, height, getComputedStyle(canvas).fontFamily);
}

function drawFloor({ context, at }: Screen, isEdgeOn: boolean): void {
  context.strokeStyle = cssColor("--color-line");
  context.lineWidth = 1;
  context.beginPath();
  if (isEdgeOn) {
    context.moveTo(...at({ x: -FLOOR_M, y: 0, z: 0 }));
    context.lineTo(...at({ x: FLOOR_M, y: 0, z: 0 }));
  } else {
    for (let position = -FLOOR_M; position <= FLOOR_M + 1e-6; position += 0.1) {
      context.moveTo(...at({ x: position, y: -FLOOR_M, z: 0 }));
      context.lineTo(...at({ x: position, y: FLOOR_M, z: 0 }));
      context.moveTo(...at({ x: -FLOOR_M, y: position, z: 0 }));
      context.lineTo(...at({ x: FLOOR_M, y: position, z: 0 }));
    }
  }
  context.stroke();
}

function drawBodies({ context, onScreen }: Screen, picture: Picture, isKnown: boolean): void {
  const edge = cssColor("--color-ground");
  const hairline = cssColor("--color-line-strong");
  for (const face of visibleFaces(picture.measured, picture.camera)) {
    if (face.isArm && !isKnown) continue;
    context.beginPath();
    for (const point of face.outline) context.lineTo(...onScreen(point));
    context.closePath();
    const fill = face.isArm ? armColor(face.light, picture.isStale) : chassisColor(face.light);
    context.fillStyle = fill;
    context.fill();
    // The sides of a cylinder have no edges between them; their seams are closed by their own color.
    context.strokeStyle = face.isSmooth ? fill : face.isArm ? edge : hairline;
    context.lineWidth = 1;
    context.stroke();
  }
}

function armColor(light: number, isStale: boolean): string {
  const level = isStale ? 0.25 + 0.25 * light : 0.38 + 0.6 * light;
  return `rgb(${Math.round(233 * level)} ${Math.round(242 * level)} ${Math.round(235 * level)})`;
}

function chassisColor(light: number): string {
  return `rgb(${Math.round(18 + 22 * light)} ${Math.round(24 + 30 * light)} ${Math.round(20 + 25 * light)})`;
}

function drawGhost({ context, at }: Screen, commanded: Angles): void {
  const { chain, fingers } = skeleton(commanded);
  const alive = cssColor("--color-alive");
  const lines: readonly (readonly Vector[])[] = [chain, ...fingers, fingers.map(([from]) => from)];
  // A dark line below the dashes keeps them visible over the light arm.
  for (const [color, width, dash] of [[cssColor("--color-ground"), 5, []], [alive, 2.5, [7, 6]]] as const) {
    context.strokeStyle = color;
    context.lineWidth = width;
    context.setLineDash([...dash]);
    context.beginPath();
    for (const line of lines) for (const [index, point] of line.entries()) context[index === 0 ? "moveTo" : "lineTo"](...at(point));
    context.stroke();
  }
  context.setLineDash([]);
  for (const point of chain.slice(1, 4)) {
    context.beginPath();
    context.arc(...at(point), 5, 0, 2 * Math.PI);
    context.fillStyle = cssColor("--color-ground");
    context.fill();
    context.stroke();
  }
}

const TONES: Record<JointLabel["tone"], string> = {
  calm: "--color-text-2",
  moving: "--color-alive",
  attention: "--color-attention",
  lost: "--color-text-3",
};
/** Sizes at a root font size of 16 px; the labels scale with it, as it is larger on a wall display. */
const LETTER_PX = 16;
const LABEL_HEIGHT = 40;
const LABEL_DISTANCE = 92;
const LABEL_WIDTH = 120;
/** Above the labels are the choice of the view, at the left, and what is said of old samples. */
const FIRST_LABEL_Y = { left: 64, right: 44 };

function drawLabels({ context, at }: Screen, picture: Picture, width: number, height: number, font: string): void {
  const { chain, fingers } = skeleton(picture.measured);
  const [pan, lift, elbow, wrist] = chain;
  const tip = fingers[0]?.[1];
  const places: Record<JointName, Vector | undefined> = {
    shoulder_pan_joint: pan,
    shoulder_lift_joint: lift,
    elbow_joint: elbow,
    wrist_joint: wrist,
    gripper_joint: tip,
  };
  for (const { joint, tone } of picture.labels) {
    const place = places[joint];
    if (place === undefined || joint === "gripper_joint" || joint === "shoulder_pan_joint") continue;
    context.beginPath();
    context.arc(...at(place), 8, 0, 2 * Math.PI);
    context.fillStyle = cssColor("--color-ground");
    context.fill();
    context.lineWidth = 3;
    context.strokeStyle = cssColor(tone === "calm" ? "--color-sensed" : TONES[tone]);
    context.stroke();
  }
  if (width < LABELS_FROM_PX) return;
  const unit = Number.parseFloat(getComputedStyle(document.documentElement).fontSize) / LETTER_PX || 1;
  const chainX = chain.map((point) => at(point)[0]);
  const middle = (Math.min(...chainX) + Math.max(...chainX)) / 2;
  const spread = Math.max(...chainX) - Math.min(...chainX);
  const sides: Record<"left" | "right", { label: JointLabel; x: number; y: number }[]> = { left: [], right: [] };
  for (const [index, label] of picture.labels.entries()) {
    const place = places[label.joint];
    if (place === undefined) continue;
    const [x, y] = at(place);
    // An upright arm leans to neither side: its labels alternate between the sides.
    const isLeft = spread < 60 ? index % 2 === 1 : x < middle;
    sides[isLeft ? "left" : "right"].push({ label, x, y });
  }
  for (const side of ["left", "right"] as const) {
    let free = FIRST_LABEL_Y[side] * unit;
    for (const { label, x, y } of sides[side].toSorted((a, b) => a.y - b.y)) {
      const top = Math.min(height - LABEL_HEIGHT * unit, Math.max(free, y - 44 * unit));
      free = top + (LABEL_HEIGHT + 6) * unit;
      const left = side === "left" ? Math.max(LABEL_WIDTH * unit, x - LABEL_DISTANCE * unit) : Math.min(width - LABEL_WIDTH * unit, x + LABEL_DISTANCE * unit);
      drawLabel(context, label, [x, y], [left, top], side, font, unit);
    }
  }
}

function drawLabel(context: CanvasRenderingContext2D, label: JointLabel, from: [number, number], [x, y]: [number, number], side: "left" | "right", font: string, unit: number): void {
  const away = side === "left" ? -1 : 1;
  context.strokeStyle = cssColor("--color-line-strong");
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(from[0] + away * 11, from[1] - 3);
  context.lineTo(x - away * 6, y + 14 * unit);
  context.stroke();
  context.textAlign = side === "left" ? "right" : "left";
  context.textBaseline = "middle";
  context.font = `600 ${15 * unit}px ${font}`;
  context.fillStyle = cssColor(label.tone === "lost" ? "--color-text-3" : "--color-text");
  context.fillText(label.title, x, y + 10 * unit);
  context.font = `${13 * unit}px ${font}`;
  context.fillStyle = cssColor(TONES[label.tone]);
  context.fillText(label.note, x, y + 28 * unit);
}
