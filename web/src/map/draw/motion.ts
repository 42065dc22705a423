/** What moves, drawn from above: scan, trail, plan, robot, and the pose that is being drawn. */
import { BASE, CHASSIS, type Outline, WHEELS, cornersAt } from "@/robot/footprint";
import type { LiveMap } from "@/map/live_map";
import type { Draft, Preview } from "@/map/map_ui";
import { type TrailPoint, shownPlan } from "@/map/route";
import { type Point, type Size, type View, toScreen, toScreenAngle } from "@/map/view";
import { type Pose2, compose } from "@/ros/tf";
import { fade } from "@/widgets/canvas";
import { FRESH_TRAIL_MS, OLD_PLAN, RING_M, SCAN_LIGHT_M, SCAN_LIGHT_OPACITY, inks, robotColor } from "./ink";

/** The robot's mark is never smaller than this, however far away the view is. */
const SMALLEST_ROBOT_PX = 15;

export interface MotionStyle {
  isStopped: boolean;
  /** The link is lost, or the robot's place is out of date. */
  isPoseStale: boolean;
  isScanStale: boolean;
  nowMs: number;
}

/** Draws what lies on the floor, in whichever view projects it. */
class Pen {
  constructor(
    readonly context: CanvasRenderingContext2D,
    readonly project: (point: Point) => Point,
    /** CSS pixels per meter. */
    readonly scale: number,
  ) {}

  trace(points: readonly Point[], close = false): void {
    this.context.beginPath();
    points.forEach((point, index) => {
      const { x, y } = this.project(point);
      if (index === 0) this.context.moveTo(x, y);
      else this.context.lineTo(x, y);
    });
    if (close) this.context.closePath();
  }

  traceCircle(center: Point, radiusM: number): void {
    const corners = Array.from({ length: 40 }, (_, step) => {
      const angle = (step / 40) * 2 * Math.PI;
      return { x: center.x + radiusM * Math.cos(angle), y: center.y + radiusM * Math.sin(angle) };
    });
    this.trace(corners, true);
  }

  fill(color: string): void {
    this.context.fillStyle = color;
    this.context.fill();
  }

  stroke(color: string, width: number, dash: number[] = []): void {
    this.context.strokeStyle = color;
    this.context.lineWidth = width;
    this.context.setLineDash(dash);
    this.context.stroke();
    if (dash.length > 0) this.context.setLineDash([]);
  }
}

function fromAbove(context: CanvasRenderingContext2D, view: View, size: Size): Pen {
  return new Pen(context, (point) => toScreen(view, size, point), view.scale);
}

export function drawMotion(context: CanvasRenderingContext2D, view: View, size: Size, live: LiveMap, style: MotionStyle): void {
  const pen = fromAbove(context, view, size);
  context.lineCap = "round";
  context.lineJoin = "round";
  if (!style.isScanStale) drawScan(pen, live);
  drawTrail(pen, live.trail.points, style);
  drawPlan(pen, live, style);
}

/** The floor that the lidar sees, and its echoes. */
function drawScan(pen: Pen, live: LiveMap): void {
  const { scan } = live;
  if (scan === null || scan.echoes.length < 2) return;
  const { context, project, scale } = pen;
  const from = project(scan.from);
  context.beginPath();
  for (let index = 0; index < scan.echoes.length; index += 2) {
    const { x, y } = project({ x: scan.echoes[index] ?? 0, y: scan.echoes[index + 1] ?? 0 });
    if (index === 0) context.moveTo(x, y);
    else context.lineTo(x, y);
  }
  context.closePath();
  const light = context.createRadialGradient(from.x, from.y, 0, from.x, from.y, scale * SCAN_LIGHT_M);
  light.addColorStop(0, fade(inks().sensed, SCAN_LIGHT_OPACITY));
  light.addColorStop(1, fade(inks().sensed, 0));
  context.fillStyle = light;
  context.fill();
  context.fillStyle = inks().sensed;
  const dot = scale > 90 ? 3 : 2;
  for (let index = 0; index < scan.echoes.length; index += 2) {
    const { x, y } = project({ x: scan.echoes[index] ?? 0, y: scan.echoes[index + 1] ?? 0 });
    context.fillRect(x - dot / 2, y - dot / 2, dot, dot);
  }
}

/** The last 45 s fade away; what is older is a thread. */
function drawTrail(pen: Pen, points: readonly TrailPoint[], style: MotionStyle): void {
  const { context, project } = pen;
  const firstFresh = points.findIndex((point) => style.nowMs - point.atMs < FRESH_TRAIL_MS);
  const end = firstFresh < 0 ? points.length : firstFresh;
  context.beginPath();
  points.slice(0, end + 1).forEach((point, index) => {
    const { x, y } = project(point);
    if (index === 0 || point.begins) context.moveTo(x, y);
    else context.lineTo(x, y);
  });
  pen.stroke(fade(inks().alive, 0.16), 1.5);
  const color = style.isStopped ? OLD_PLAN : inks().aliveDim;
  // Few steps of opacity, each one path: a path per segment would take most of a frame.
  const steps = 6;
  const fresh = points.slice(end);
  for (let step = 0; step < steps; step += 1) {
    context.beginPath();
    fresh.forEach((point, index) => {
      const before = fresh[index - 1];
      if (before === undefined || point.begins) return;
      const age = (style.nowMs - point.atMs) / FRESH_TRAIL_MS;
      if (Math.min(steps - 1, Math.floor(age * steps)) !== step) return;
      const [from, to] = [project(before), project(point)];
      context.moveTo(from.x, from.y);
      context.lineTo(to.x, to.y);
    });
    const share = 1 - step / steps;
    pen.stroke(fade(color, 0.15 + 0.65 * share * share), 2 + 1.5 * share);
  }
}

function drawPlan(pen: Pen, live: LiveMap, style: MotionStyle): void {
  const shown = shownPlan(live.plan, live.pose, style.nowMs);
  if (shown === null) return;
  const { left } = shown;
  const isOld = !shown.isFollowed || style.isStopped;
  pen.trace(left);
  if (isOld) {
    pen.stroke(OLD_PLAN, 2, [2, 7]);
  } else {
    pen.stroke(fade(inks().alive, 0.2), 9);
    pen.stroke(inks().alive, 3.5);
  }
  const end = left.at(-1);
  if (end !== undefined) drawRing(pen, end, 0.2, isOld ? inks().text2 : inks().alive, 2, isOld ? [3, 5] : [], isOld ? null : fade(inks().alive, 0.14));
}

function drawRing(pen: Pen, at: Point, radiusM: number, color: string, width: number, dash: number[], fill: string | null): void {
  pen.traceCircle(at, Math.max(6 / pen.scale, radiusM));
  if (fill !== null) pen.fill(fill);
  pen.stroke(color, width, dash);
}

/** The robot as large as it is, in a ring that can be seen from afar. */
export function drawRobot(context: CanvasRenderingContext2D, view: View, size: Size, pose: Pose2, style: MotionStyle): void {
  const pen = fromAbove(context, view, size);
  const ink = inks();
  const color = robotColor(style);
  const { x, y } = toScreen(view, size, pose);
  const radius = Math.max(SMALLEST_ROBOT_PX, RING_M * view.scale);
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = style.isStopped && !style.isPoseStale ? fade(ink.stop, 0.25) : fade(color, 0.12);
  context.fill();
  pen.stroke(color, style.isStopped ? 3 : 2, style.isPoseStale ? [4, 4] : []);

  drawOutlines(pen, pose, style.isPoseStale ? ink.text3 : ink.text);
  const angle = toScreenAngle(view, pose.yaw);
  context.save();
  context.translate(x, y);
  context.rotate(angle);
  context.beginPath();
  context.moveTo(radius + 9, 0);
  context.lineTo(radius - 3, 7);
  context.lineTo(radius - 1, 0);
  context.lineTo(radius - 3, -7);
  context.closePath();
  context.fillStyle = color;
  context.fill();
  context.restore();
}

function drawOutlines(pen: Pen, pose: Pose2, color: string): void {
  const shown = Math.max(1, (2 * SMALLEST_ROBOT_PX * 0.6) / ((BASE.maxX - BASE.minX) * pen.scale));
  const scaled = ({ minX, maxX, minY, maxY }: Outline): Outline => ({ minX: minX * shown, maxX: maxX * shown, minY: minY * shown, maxY: maxY * shown });
  for (const wheel of WHEELS) {
    pen.trace(cornersAt(scaled(wheel), pose), true);
    pen.fill("#39453e");
    pen.stroke(inks().void, 0.75);
  }
  pen.trace(cornersAt(scaled(CHASSIS), pose), true);
  pen.fill(color);
  pen.stroke(inks().void, 1);
  const inner = scaled(CHASSIS);
  const nose = [
    { x: inner.maxX * 0.75, y: 0 },
    { x: inner.minX * 0.45, y: inner.maxY * 0.7 },
    { x: inner.minX * 0.2, y: 0 },
    { x: inner.minX * 0.45, y: inner.minY * 0.7 },
  ];
  pen.trace(nose.map((point) => compose(pose, { ...point, yaw: 0 })), true);
  pen.fill("#1a221d");
}

/** A drawn pose: the way to it, the robot's outline there, and an arrow where it will look. */
export function drawDraft(
  context: CanvasRenderingContext2D,
  project: (point: Point) => Point,
  scale: number,
  draft: Draft,
  preview: Preview | null,
): void {
  const pen = new Pen(context, project, scale);
  const ink = inks();
  const isImpossible = preview !== null && preview.problem !== null;
  const color = draft.kind === "goal" ? (isImpossible ? ink.attention : ink.alive) : ink.sensed;
  context.lineCap = "round";
  context.lineJoin = "round";
  if (preview !== null && preview.points.length > 1) {
    pen.trace(preview.points);
    pen.stroke(fade(ink.void, 0.7), 6);
    pen.stroke(color, 3, [1, 7]);
  }
  drawRing(pen, draft.pose, RING_M, color, 1.5, [4, 4], fade(ink.void, 0.35));
  pen.trace(cornersAt(BASE, draft.pose), true);
  pen.fill(fade(ink.void, 0.55));
  pen.stroke(color, 2.5);
  const length = Math.max(38 / scale, 0.6);
  const along = (ahead: number, aside = 0): Point => compose(draft.pose, { x: ahead, y: aside, yaw: 0 });
  const head = Math.max(13 / scale, 0.16);
  pen.trace([draft.pose, along(length - head * 0.7)]);
  pen.stroke(color, 3);
  pen.trace([along(length), along(length - head, head * 0.5), along(length - head, -head * 0.5)], true);
  pen.fill(color);
}

/** Where the robot is to stand: at a goal that was sent, or at the stored approach of a tag. */
export function drawFootprint(context: CanvasRenderingContext2D, project: (point: Point) => Point, scale: number, pose: Pose2): void {
  const pen = new Pen(context, project, scale);
  pen.trace(cornersAt(BASE, pose), true);
  pen.stroke(inks().alive, 2, [3, 4]);
}
