import { useEffect, useRef } from "react";
import { TOPICS } from "@/generated/graph";
import { useSamples } from "@/hooks/use_topic";
import { type Text, useText } from "@/i18n/text";
import { fixed } from "@/ui/numbers";
import { fitCanvas } from "../canvas";
import { className, parseFlowers, parseTags } from "./detections";
import { type Mark, type Size, drawMarks, place } from "./marks";
import { type Found, type ShownImage, findFor, keepRecent } from "./matching";

export type OverlayKind = "tags" | "flowers";

interface OverlayProps {
  kind: OverlayKind;
  size: Size;
  fit: "cover" | "contain";
  image: () => ShownImage | null;
  /** Called with the function that draws the marks anew, for when another image is shown. */
  onReady: (redraw: () => void) => void;
}

/** What a detector found in the camera's image, drawn over it while it is new enough to fit. */
export function Overlay({ kind, size, fit, image, onReady }: OverlayProps) {
  const text = useText();
  const canvas = useRef<HTMLCanvasElement>(null);
  const found = useRef<Found[]>([]);

  function draw(): void {
    const drawing = canvas.current === null ? null : fitCanvas(canvas.current);
    if (drawing === null) return;
    const { context, width, height } = drawing;
    const shown = image();
    const message = shown === null ? null : findFor(found.current, shown);
    context.clearRect(0, 0, width, height);
    drawMarks(context, message === null ? [] : marksOf(kind, message, text), place(size, { width, height }, fit), { width, height });
  }

  useSamples(kind === "tags" ? TOPICS.TAG_DETECTIONS : TOPICS.FLOWER_DETECTIONS, ({ message, receivedMs }) => {
    found.current = keepRecent(found.current, { text: message.data, receivedMs });
    draw();
  });

  useEffect(() => {
    onReady(draw);
    const element = canvas.current;
    if (element === null) return;
    const observer = new ResizeObserver(draw);
    observer.observe(element);
    return () => observer.disconnect();
  });

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
