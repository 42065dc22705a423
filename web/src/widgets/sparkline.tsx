import { useEffect, useRef } from "react";
import { cn } from "@/ui/cn";
import { cssColor, fitCanvas } from "./canvas";
import { type TimeSeries, alignedWindow, bucketize } from "./time_series";

interface SparklineProps {
  series: TimeSeries;
  label: string;
  /** The smallest range of the axis, so that noise is not magnified. */
  minSpan: number;
  /** Draw the line of 0 and keep it in the picture. */
  withZero?: boolean;
  isStale?: boolean;
  className?: string;
}

const SHORTEST_MS = 100;
const PADDING = 5;

/** The last minutes of a value as a line, drawn when the value changes. */
export function Sparkline({ series, label, minSpan, withZero = false, isStale = false, className }: SparklineProps) {
  const canvas = useRef<HTMLCanvasElement>(null);

  useEffect(() => {
    const element = canvas.current;
    if (element === null) return;
    let timer: ReturnType<typeof setTimeout> | undefined;
    const draw = () => {
      timer = undefined;
      drawLine(element, series, minSpan, withZero, isStale);
    };
    const drawSoon = () => {
      timer ??= setTimeout(draw, SHORTEST_MS);
    };
    const end = series.listen(drawSoon);
    const observer = new ResizeObserver(draw);
    observer.observe(element);
    draw();
    return () => {
      end();
      observer.disconnect();
      clearTimeout(timer);
    };
  }, [series, minSpan, withZero, isStale]);

  return <canvas ref={canvas} role="img" aria-label={label} className={cn("w-full", className)} />;
}

function drawLine(canvas: HTMLCanvasElement, series: TimeSeries, minSpan: number, withZero: boolean, isStale: boolean): void {
  const drawing = fitCanvas(canvas);
  if (drawing === null) return;
  const { context, width, height } = drawing;
  context.clearRect(0, 0, width, height);
  if (series.size === 0) return;
  const count = Math.max(10, Math.floor(width / 2));
  const { fromS, toS } = alignedWindow(series.lastTime, series.windowS, count);
  const { times, values } = bucketize(series, fromS, toS, count);
  const known = values.filter((value): value is number => typeof value === "number");
  if (known.length === 0) return;
  let [low, high] = [Math.min(...known, withZero ? 0 : Infinity), Math.max(...known, withZero ? 0 : -Infinity)];
  const missing = Math.max(0, minSpan - (high - low)) / 2;
  [low, high] = [low - missing, high + missing];
  const toX = (time: number) => PADDING + ((time - fromS) / series.windowS) * (width - 2 * PADDING);
  const toY = (value: number) => height - PADDING - ((value - low) / (high - low)) * (height - 2 * PADDING);
  if (withZero) {
    context.fillStyle = cssColor("--color-line-strong");
    context.fillRect(0, Math.round(toY(0)), width, 1);
  }
  context.strokeStyle = cssColor(isStale ? "--color-text-3" : "--color-sensed");
  context.lineWidth = 1.75;
  context.lineJoin = "round";
  context.beginPath();
  let isPenDown = false;
  for (const [index, value] of values.entries()) {
    if (value === undefined) continue;
    if (value === null) isPenDown = false;
    else {
      context[isPenDown ? "lineTo" : "moveTo"](toX(times[index] ?? 0), toY(value));
      isPenDown = true;
    }
  }
  context.stroke();
  context.fillStyle = context.strokeStyle;
  context.beginPath();
  context.arc(toX(series.lastTime), toY(known.at(-1) ?? 0), 3, 0, 2 * Math.PI);
  context.fill();
}
