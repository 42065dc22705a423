/** Marks over an image: outlines with a label, in the image's own pixels. */
import { cssColor } from "../canvas";
import type { Point } from "./detections";

export interface Mark {
  points: readonly Point[];
  label: string;
}

export interface Size {
  width: number;
  height: number;
}

export interface Placement {
  left: number;
  top: number;
  scale: number;
}

/** Where an image lies in a box that it fits into, or that it covers, as CSS `object-fit` places it. */
export function place(image: Size, box: Size, fit: "contain" | "cover"): Placement {
  const [x, y] = [box.width / image.width, box.height / image.height];
  const scale = fit === "contain" ? Math.min(x, y) : Math.max(x, y);
  return { left: (box.width - scale * image.width) / 2, top: (box.height - scale * image.height) / 2, scale };
}

const PADDING_PX = 8;
const LABEL_PX = 20;
/** In images that are shown smaller than this, labels are smaller. */
const SMALL_PX = 480;
const SMALL_LABEL_PX = 13;

/** Draw marks into a context in CSS pixels. */
export function drawMarks(context: CanvasRenderingContext2D, marks: readonly Mark[], { left, top, scale }: Placement, box: Size): void {
  const isSmall = box.width < SMALL_PX;
  for (const { points, label } of marks) {
    const shown = points.map(([x, y]): Point => [left + x * scale, top + y * scale]);
    outline(context, shown, cssColor("--color-void"), isSmall ? 4 : 6);
    outline(context, shown, cssColor("--color-sensed"), isSmall ? 2 : 3);
    drawLabel(context, label, shown, box, isSmall ? SMALL_LABEL_PX : LABEL_PX);
  }
}

function outline(context: CanvasRenderingContext2D, points: readonly Point[], color: string, width: number): void {
  context.strokeStyle = color;
  context.lineWidth = width;
  context.lineJoin = "round";
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.closePath();
  context.stroke();
}

/** Above the mark, or below it where there is no room, and always within the image. */
function drawLabel(context: CanvasRenderingContext2D, text: string, points: readonly Point[], box: Size, size: number): void {
  const [xs, ys] = [points.map(([x]) => x), points.map(([, y]) => y)];
  context.font = `600 ${size}px ${getComputedStyle(context.canvas).fontFamily}`;
  const width = context.measureText(text).width + 2 * PADDING_PX;
  const height = size + PADDING_PX;
  const x = Math.max(0, Math.min(Math.min(...xs), box.width - width));
  const above = Math.min(...ys) - height - 6;
  const y = above >= 0 ? above : Math.min(Math.max(...ys) + 6, box.height - height);
  context.fillStyle = cssColor("--color-sensed");
  context.beginPath();
  context.roundRect(x, y, width, height, 4);
  context.fill();
  context.fillStyle = cssColor("--color-void");
  context.textBaseline = "middle";
  context.textAlign = "left";
  context.fillText(text, x + PADDING_PX, y + height / 2 + 1);
}
