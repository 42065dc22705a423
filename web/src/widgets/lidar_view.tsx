import { useEffect, useEffectEvent, useRef } from "react";
import { TOPICS } from "@/generated/graph";
import type { sensor_msgs_LaserScan } from "@/generated/messages";
import { CHASSIS, OUTER_RADIUS_M } from "@/generated/robot";
import { useSamples } from "@/hooks/use_topic";
import { MODEL_MOUNT, type Mount, echoesOf, mountOf } from "@/ros/scan";
import { TransformTree } from "@/ros/tf";
import { useSetting } from "@/state/settings";
import { cssColor, fitCanvas } from "./canvas";

export interface Echo {
  /** Forward and left of the robot's center, m. */
  x: number;
  y: number;
}

/** The echoes of a scan around the robot; rays without one are left out. */
export function echoes(scan: sensor_msgs_LaserScan, mount: Mount = MODEL_MOUNT): Echo[] {
  const points = echoesOf(scan, mount);
  return Array.from({ length: points.length / 2 }, (_, at) => ({ x: points[2 * at] ?? NaN, y: points[2 * at + 1] ?? NaN }));
}

/** The distance in m from the robot's outline to the nearest echo; null without echoes. */
export function nearest(points: readonly Echo[]): number | null {
  let best = Infinity;
  for (const { x, y } of points) best = Math.min(best, Math.hypot(x, y));
  return Number.isFinite(best) ? Math.max(0, best - OUTER_RADIUS_M) : null;
}

interface LidarViewProps {
  rangeM?: number;
  label: string;
  onScan?: (scan: { nearestM: number | null; receivedMs: number }) => void;
}

/** The scan from above, the robot in the middle looking up. Drawn raw, with every scan. */
export function LidarView({ rangeM = 3.2, label, onScan }: LidarViewProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const points = useRef<Echo[]>([]);
  const tree = useRef(new TransformTree());
  const [name, base] = [useSetting("scanTopic"), useSetting("baseFrame")];

  function draw(): void {
    if (canvas.current !== null) drawScan(canvas.current, points.current, rangeM);
  }
  const drawAnew = useEffectEvent(draw);

  useSamples(TOPICS.TF_STATIC, ({ message }) => tree.current.update(message));
  useSamples({ name, type: TOPICS.SCAN.type }, ({ message, receivedMs }) => {
    const known = tree.current.transform(base, message.header.frame_id);
    const mount = known === null ? MODEL_MOUNT : mountOf(known);
    points.current = mount === null ? [] : echoes(message, mount);
    onScan?.({ nearestM: nearest(points.current), receivedMs });
    draw();
  });

  useEffect(() => {
    const element = canvas.current;
    if (element === null) return;
    const observer = new ResizeObserver(() => drawAnew());
    observer.observe(element);
    return () => observer.disconnect();
  }, []);

  return <canvas ref={canvas} role="img" aria-label={label} className="size-full" />;
}

function drawScan(canvas: HTMLCanvasElement, points: readonly Echo[], rangeM: number): void {
  const drawing = fitCanvas(canvas);
  if (drawing === null) return;
  const { context, width, height } = drawing;
  const scale = Math.min(width, height) / 2 / rangeM;
  const toX = (left: number) => width / 2 - left * scale;
  const toY = (forward: number) => height / 2 - forward * scale;
  context.clearRect(0, 0, width, height);
  context.lineWidth = 1;
  context.font = `11px ${getComputedStyle(canvas).fontFamily}`;
  context.textAlign = "center";
  for (let ring = 1; ring <= rangeM; ring += 1) {
    context.strokeStyle = cssColor("--color-line-strong");
    context.beginPath();
    context.arc(width / 2, height / 2, ring * scale, 0, 2 * Math.PI);
    context.stroke();
    context.fillStyle = cssColor("--color-text-3");
    context.fillText(`${ring} m`, width / 2, toY(ring) + 12);
  }
  context.fillStyle = cssColor("--color-sensed");
  for (const { x, y } of points) context.fillRect(toX(y) - 1.5, toY(x) - 1.5, 3, 3);
  context.fillStyle = cssColor("--color-text");
  context.fillRect(toX(CHASSIS.halfWidthM), toY(CHASSIS.halfLengthM), 2 * CHASSIS.halfWidthM * scale, 2 * CHASSIS.halfLengthM * scale);
  context.fillStyle = cssColor("--color-alive");
  context.beginPath();
  context.moveTo(width / 2, toY(0.32));
  context.lineTo(width / 2 - 6, toY(0.2));
  context.lineTo(width / 2 + 6, toY(0.2));
  context.fill();
}
