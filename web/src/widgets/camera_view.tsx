import { RotateCw } from "lucide-react";
import { type RefObject, useEffect, useRef, useState } from "react";
import { useNow } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import { robotTime } from "@/robot";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { fixed, span } from "@/ui/numbers";
import { type Arrival, CameraStream, type StreamState, medianLatencyS } from "./camera/camera_stream";
import { Overlay, type OverlayKind } from "./camera/overlay";

/** Older than this, a picture says nothing about now. */
export const STALLED_MS = 2000;
/** How many pictures the shown latency is the median of. */
const RECENT = 10;

interface CameraViewProps {
  /** null while it is not known yet. */
  topic: string | null;
  label: string;
  className?: string;
  fit?: "cover" | "contain";
  /** What to draw over the picture; only what is found with this camera. */
  overlay?: OverlayKind | null;
  /** Show rate and latency in the corner, and the size too. */
  numbers?: "short" | "all";
}

interface Shown {
  receivedMs: number;
  width: number;
  height: number;
  /** When the last pictures were taken and arrived. */
  recent: readonly Arrival[];
}

/** The pictures of a camera, filling their place, and what is wrong where there are none. */
export function CameraView({ topic, label, className, fit = "cover", overlay = null, numbers }: CameraViewProps) {
  const text = useText();
  const canvas = useRef<HTMLCanvasElement>(null);
  const stream = useRef<CameraStream | null>(null);
  const [state, setState] = useState<StreamState>({ kind: "opening" });
  const [size, setSize] = useState<{ width: number; height: number } | null>(null);
  const shown = useRef<Shown | null>(null);

  useEffect(() => {
    if (topic === null) return;
    const opened = new CameraStream(topic, {
      state: (next) => setState((before) => (before.kind === "live" && next.kind === "live" ? before : next)),
      picture: ({ bitmap, stampS, receivedMs }) => {
        const { width, height } = bitmap;
        const recent = [...(shown.current?.recent ?? []), { receivedMs, stampS }].slice(-RECENT);
        shown.current = { receivedMs, width, height, recent };
        drawPicture(canvas.current, bitmap);
        bitmap.close();
        setSize((before) => (before?.width === width && before.height === height ? before : { width, height }));
      },
    });
    stream.current = opened;
    opened.start();
    return () => {
      opened.close();
      shown.current = null;
    };
  }, [topic]);

  return (
    <div className={cn("relative overflow-hidden bg-well", className)}>
      <canvas
        ref={canvas}
        role="img"
        aria-label={label}
        width={1}
        height={1}
        className={cn("absolute inset-0 size-full", fit === "cover" ? "object-cover" : "object-contain", size === null && "invisible")}
      />
      {overlay !== null && size !== null && <Overlay kind={overlay} size={size} fit={fit} />}
      {numbers !== undefined && <Numbers shown={shown} stream={stream} withSize={numbers === "all"} />}
      <Condition state={state} shown={shown} topic={topic ?? ""} onReload={() => stream.current?.reload()} />
      <span className="sr-only">{text(`camera_${state.kind}`)}</span>
    </div>
  );
}

function drawPicture(canvas: HTMLCanvasElement | null, bitmap: ImageBitmap): void {
  if (canvas === null) return;
  if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
    canvas.width = bitmap.width;
    canvas.height = bitmap.height;
  }
  canvas.getContext("2d")?.drawImage(bitmap, 0, 0);
}

/** What keeps new pictures from coming. Nothing while they come. */
function Condition({
  state,
  shown,
  topic,
  onReload,
}: {
  state: StreamState;
  shown: RefObject<Shown | null>;
  topic: string;
  onReload: () => void;
}) {
  const text = useText();
  const now = useNow();
  const [since] = useState(() => performance.now());
  const age = shown.current === null ? null : (now - shown.current.receivedMs) / 1000;
  const stalled = age !== null && age * 1000 > STALLED_MS;
  if (state.kind === "live" && !stalled) return null;
  if (state.kind === "opening" && (age !== null ? !stalled : now - since < 300)) return null;
  const wait = "retryMs" in state ? Math.max(0, Math.ceil((state.retryMs - now) / 1000)) : null;
  const message =
    state.kind === "refused"
      ? text("camera_refused_reason", { reason: state.reason })
      : age !== null
        ? text("camera_stalled", { age: span(age) })
        : text(topic === "" ? "cameras_asking" : state.kind === "lost" ? "camera_no_answer" : "camera_waiting", { topic });
  return (
    <div className={cn("pointer-events-none absolute inset-0 z-20 grid place-items-center p-4", age === null ? "" : "bg-void/60 hatched")}>
      <div className="flex max-w-md flex-col items-center gap-3 rounded-md bg-panel px-5 py-4 text-center pointer-events-auto" role="status">
        <p className={state.kind === "refused" ? "text-stop-text" : stalled ? "text-attention" : "text-text-2"}>{message}</p>
        {wait !== null && <p className="text-xs text-text-3">{text("camera_retry", { seconds: wait })}</p>}
        {(stalled || state.kind !== "opening") && (
          <Button size="small" onClick={onReload}>
            <RotateCw />
            {text("camera_reload")}
          </Button>
        )}
      </div>
    </div>
  );
}

function Numbers({
  shown,
  stream,
  withSize,
}: {
  shown: RefObject<Shown | null>;
  stream: RefObject<CameraStream | null>;
  withSize: boolean;
}) {
  const text = useText();
  const now = useNow();
  const picture = shown.current;
  if (picture === null || now - picture.receivedMs > STALLED_MS) return null;
  const rate = stream.current?.rate(now) ?? null;
  const latency = medianLatencyS(picture.recent, robotTime);
  return (
    <p className="absolute top-3 right-3 rounded-sm bg-panel/90 px-2.5 py-1 text-sm">
      <span className="numeric">{fixed(rate, 0)}</span> {text("camera_fps")}
      {latency !== null && (
        <>
          {" · "}
          <span className="numeric">{fixed(latency * 1000, 0)}</span> ms
        </>
      )}
      {withSize && (
        <span className="max-lg:hidden">
          {" · "}
          <span className="numeric">{picture.width}</span> × <span className="numeric">{picture.height}</span>
        </span>
      )}
    </p>
  );
}
