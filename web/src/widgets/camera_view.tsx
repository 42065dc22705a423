import { RotateCw } from "lucide-react";
import { type RefObject, useEffect, useRef, useState } from "react";
import { useNow } from "@/hooks/use_now";
import { useTopics } from "@/hooks/use_topic";
import { useText } from "@/i18n/text";
import { robotTime } from "@/robot/link";
import { useIsRewound, useRewind } from "@/state/rewind";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { fixed, formatDuration, writeMoment } from "@/ui/numbers";
import { type Arrival, CameraStream, type ImageFeed, type StreamListener, type StreamState, medianLatencyS } from "./camera/camera_stream";
import { Overlay, type OverlayKind } from "./camera/overlay";
import { RecordedImages } from "./camera/recorded_images";

/** Older than this, an image says nothing about now. */
export const STALLED_MS = 2000;
/** How many images the shown latency is the median of. */
const RECENT = 10;

interface CameraViewProps {
  /** null while it is not known yet. */
  topic: string | null;
  label: string;
  className?: string;
  fit?: "cover" | "contain";
  /** What to draw over the image; only what is found with this camera. */
  overlay?: OverlayKind | null;
  /** Show rate and latency in the corner, and the size too. */
  numbers?: "short" | "all";
}

interface Shown {
  receivedMs: number;
  width: number;
  height: number;
  /** When the last images were taken and arrived. */
  recent: readonly Arrival[];
}

/** The images of a camera, filling their place, and what is wrong where there are none. */
export function CameraView({ topic, label, className, fit = "cover", overlay = null, numbers }: CameraViewProps) {
  const text = useText();
  const canvas = useRef<HTMLCanvasElement>(null);
  const stream = useRef<ImageFeed | null>(null);
  const store = useTopics();
  const isRewound = useIsRewound();
  const drawOverlay = useRef(() => {});
  const [state, setState] = useState<StreamState>({ kind: "opening" });
  const [size, setSize] = useState<{ width: number; height: number } | null>(null);
  const shown = useRef<Shown | null>(null);

  useEffect(() => {
    if (topic === null) return;
    const listener: StreamListener = {
      state: (next) => {
        setState((before) => (before.kind === "live" && next.kind === "live" ? before : next));
        if (next.kind !== "missing") return;
        shown.current = null;
        setSize(null);
      },
      image: ({ bitmap, stampS, receivedMs }) => {
        const { width, height } = bitmap;
        const recent = [...(shown.current?.recent ?? []), { receivedMs, stampS }].slice(-RECENT);
        shown.current = { receivedMs, width, height, recent };
        drawImage(canvas.current, bitmap);
        bitmap.close();
        setSize((before) => (before?.width === width && before.height === height ? before : { width, height }));
        drawOverlay.current();
      },
    };
    const opened = isRewound ? new RecordedImages(store, topic, listener) : new CameraStream(topic, listener);
    stream.current = opened;
    opened.start();
    return () => {
      opened.close();
      shown.current = null;
      setSize(null);
    };
  }, [topic, store, isRewound]);

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
      {overlay !== null && size !== null && (
        <Overlay
          kind={overlay}
          size={size}
          fit={fit}
          image={() => shown.current?.recent.at(-1) ?? null}
          onReady={(redraw) => {
            drawOverlay.current = redraw;
          }}
        />
      )}
      {numbers !== undefined && isRewound && <Moment shown={shown} />}
      {numbers !== undefined && !isRewound && <Numbers shown={shown} stream={stream} withSize={numbers === "all"} />}
      <Condition state={state} shown={shown} topic={topic ?? ""} onReload={() => stream.current?.reload()} />
      <span className="sr-only">{text(`camera_${state.kind}`)}</span>
    </div>
  );
}

function drawImage(canvas: HTMLCanvasElement | null, bitmap: ImageBitmap): void {
  if (canvas === null) return;
  if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
    canvas.width = bitmap.width;
    canvas.height = bitmap.height;
  }
  canvas.getContext("2d")?.drawImage(bitmap, 0, 0);
}

/** What keeps new images from coming. Nothing while they come. */
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
  const isRewound = useIsRewound();
  const isLoading = useRewind((rewind) => rewind.isLoading);
  const age = shown.current === null ? null : (now - shown.current.receivedMs) / 1000;
  const stalled = age !== null && age * 1000 > STALLED_MS;
  if (state.kind === "live" && !stalled) return null;
  if (state.kind === "opening" && (age !== null ? !stalled : now - since < 300)) return null;
  const wait = "retryMs" in state ? Math.max(0, Math.ceil((state.retryMs - now) / 1000)) : null;
  const message =
    state.kind === "refused"
      ? text("camera_refused_reason", { reason: state.reason })
      : state.kind === "missing"
        ? text(isLoading ? "rewind_loading" : "rewind_no_image", { topic })
        : age !== null
          ? text("camera_stalled", { age: formatDuration(age) })
          : text(topic === "" ? "cameras_asking" : state.kind === "lost" ? "camera_no_answer" : "camera_waiting", { topic });
  return (
    <div className={cn("pointer-events-none absolute inset-0 z-20 grid place-items-center p-4", age === null ? "" : "bg-void/60 hatched")}>
      <div className="flex max-w-md flex-col items-center gap-3 rounded-md bg-panel px-5 py-4 text-center pointer-events-auto">
        <p role={age === null ? "status" : undefined} className={state.kind === "refused" ? "text-stop-text" : stalled ? "text-attention" : "text-text-2"}>{message}</p>
        {wait !== null && <p className="text-xs text-text-3">{text("camera_retry", { seconds: wait })}</p>}
        {(stalled || state.kind !== "opening") && !isRewound && (
          <Button size="small" onClick={onReload}>
            <RotateCw />
            {text("camera_reload")}
          </Button>
        )}
      </div>
    </div>
  );
}

/** When a recorded image was taken. */
function Moment({ shown }: { shown: RefObject<Shown | null> }) {
  const text = useText();
  useNow();
  const stampS = shown.current?.recent.at(-1)?.stampS ?? null;
  if (stampS === null) return null;
  return <p className="absolute top-3 right-3 rounded-sm border border-attention bg-panel/90 px-2.5 py-1 text-sm numeric">{text("rewind_image_age", { time: writeMoment(stampS) })}</p>;
}

function Numbers({
  shown,
  stream,
  withSize,
}: {
  shown: RefObject<Shown | null>;
  stream: RefObject<ImageFeed | null>;
  withSize: boolean;
}) {
  const text = useText();
  const now = useNow();
  const image = shown.current;
  if (image === null || now - image.receivedMs > STALLED_MS) return null;
  const rate = stream.current?.rate(now) ?? null;
  const latency = medianLatencyS(image.recent, robotTime);
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
          <span className="numeric">{image.width}</span> × <span className="numeric">{image.height}</span>
        </span>
      )}
    </p>
  );
}
