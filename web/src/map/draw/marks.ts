/** Marks whose shape says what their color says, too. */
import type { HealthState } from "@/map/health";
import { HEALTH_COLORS } from "@/map/species";

/** Healthy is a disc, off its range the outline of a triangle, stressed a triangle, critical a square, and unknown a ring. */
export function drawHealth(context: CanvasRenderingContext2D, x: number, y: number, radius: number, state: HealthState, color?: string): void {
  const shown = color ?? HEALTH_COLORS[state];
  context.beginPath();
  switch (state) {
    case "healthy":
      context.arc(x, y, radius * 0.9, 0, 2 * Math.PI);
      break;
    case "off_range":
      triangle(context, x, y, radius * 0.9);
      strokeMark(context, shown);
      return;
    case "stressed":
      triangle(context, x, y, radius);
      break;
    case "critical":
      context.rect(x - radius * 0.85, y - radius * 0.85, radius * 1.7, radius * 1.7);
      break;
    case "no_data":
      context.arc(x, y, radius * 0.75, 0, 2 * Math.PI);
      strokeMark(context, shown);
      return;
  }
  context.fillStyle = shown;
  context.fill();
}

function triangle(context: CanvasRenderingContext2D, x: number, y: number, radius: number): void {
  context.moveTo(x, y - radius * 1.1);
  context.lineTo(x + radius * 1.15, y + radius * 0.9);
  context.lineTo(x - radius * 1.15, y + radius * 0.9);
  context.closePath();
}

function strokeMark(context: CanvasRenderingContext2D, color: string): void {
  context.strokeStyle = color;
  context.lineWidth = 1.5;
  context.stroke();
}

/** An exclamation mark on a disc: something asks for a person. */
export function drawAlarm(context: CanvasRenderingContext2D, x: number, y: number, radius: number, color: string, ink: string): void {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = color;
  context.fill();
  context.lineWidth = 2;
  context.strokeStyle = ink;
  context.stroke();
  context.fillStyle = ink;
  context.fillRect(x - 1, y - radius * 0.55, 2, radius * 0.65);
  context.fillRect(x - 1, y + radius * 0.3, 2, 2);
}
