import { useEffect, useRef } from "react";
import { TOPICS } from "@/generated/graph";
import { useSamples } from "@/hooks/use_topic";
import { type Text, useText } from "@/i18n/text";
import { fixed } from "@/ui/numbers";
import { fitCanvas } from "../canvas";
import { className, parseFlowers, parseTags } from "./detections";
import { type Mark, type Size, drawMarks, place } from "./marks";

/** Older than this, marks lie beside what they mark on a robot that turns. */
export const FITS_MS = 500;

export type OverlayKind = "tags" | "flowers";

/** What a detector found in the camera's picture, drawn over it while it is new enough to fit. */
export function Overlay({ kind, size, fit }: { kind: OverlayKind; size: Size; fit: "cover" | "contain" }) {
  const text = useText();
  const canvas = useRef<HTMLCanvasElement>(null);
  const found = useRef("");
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);

  function draw(): void {
    const drawing = canvas.current === null ? null : fitCanvas(canvas.current);
    if (drawing === null) return;
    const { context, width, height } = drawing;
    context.clearRect(0, 0, width, height);
    drawMarks(context, marksOf(kind, found.current, text), place(size, { width, height }, fit), { width, height });
  }

  useSamples(kind === "tags" ? TOPICS.TAG_DETECTIONS : TOPICS.FLOWER_DETECTIONS, ({ message, receivedMs }) => {
    const leftMs = FITS_MS - (performance.now() - receivedMs);
    found.current = leftMs > 0 ? message.data : "";
    clearTimeout(timer.current);
    timer.current = setTimeout(() => {
      found.current = "";
      draw();
    }, Math.max(0, leftMs));
    draw();
  });

  useEffect(() => {
    const element = canvas.current;
    if (element === null) return;
    const observer = new ResizeObserver(draw);
    observer.observe(element);
    return () => observer.disconnect();
  });

  useEffect(() => () => clearTimeout(timer.current), []);

  return <canvas ref={canvas} aria-hidden="true" className="pointer-events-none absolute inset-0 size-full" />;
}

function marksOf(kind: OverlayKind, message: string, text: Text): Mark[] {
  if (kind === "tags") {
    return parseTags(message).map(({ id, corners, distanceM }) => ({
      points: corners,
      label: text("camera_tag", { id, distance: `${fixed(distanceM, 2)} m` }),
    }));
  }
  return parseFlowers(message).flatMap(({ name, box }): Mark[] => {
    if (box === null) return [];
    const [left, top, right, bottom] = box;
    const key = className(name);
    return [{ points: [[left, top], [right, top], [right, bottom], [left, bottom]], label: key === null ? name : text(key) }];
  });
}
