/**
 * The images of one camera, as long as somebody looks at them.
 *
 * The stream is read by this page and not by an <img>: so each image's stamp, the server's reason for a refusal and the rate
 * of arrival are known, and a hidden page takes no images over the wireless link.
 */
import { request } from "@/api/http";
import { MalformedStream, PartReader } from "./multipart";

const RETRY_MS = 2000;
/** The server ends a silent stream after 15 s; if even that does not arrive, the connection is dead, whatever the browser believes. */
const SILENT_MS = 20_000;
const RATE_WINDOW_MS = 2500;

export type StreamState =
  | { kind: "opening" }
  | { kind: "live" }
  /** The server's words, and when it is asked again (performance.now()). */
  | { kind: "refused"; reason: string; retryMs: number }
  | { kind: "lost"; retryMs: number }
  | { kind: "hidden" }
  /** The recording has no image at the shown moment. */
  | { kind: "missing" };

export interface CameraImage {
  bitmap: ImageBitmap;
  stampS: number | null;
  receivedMs: number;
}

export interface StreamListener {
  image: (image: CameraImage) => void;
  state: (state: StreamState) => void;
}

/** How many images a second arrived lately; null before there were two. */
export function arrivalRate(arrivalsMs: readonly number[], nowMs: number): number | null {
  const recent = arrivalsMs.filter((arrival) => nowMs - arrival <= RATE_WINDOW_MS);
  const [first, last] = [recent[0], recent.at(-1)];
  if (first === undefined || last === undefined || last <= first) return null;
  return ((recent.length - 1) * 1000) / (last - first);
}

export interface Arrival {
  receivedMs: number;
  stampS: number | null;
}

/** Clocks that differ by more than these make no latency: the robot's is known to some hundredths of a second. */
const EARLIEST_S = -0.05;
const LONGEST_LATENCY_S = 30;

/** The usual time from the camera to this page; null where the robot's clock or the stamps are not known, or do not fit. */
export function medianLatencyS(arrivals: readonly Arrival[], robotTime: (atMs: number) => number | null): number | null {
  const latencies = arrivals
    .flatMap(({ receivedMs, stampS }) => {
      const arrivedS = robotTime(receivedMs);
      return arrivedS === null || stampS === null ? [] : [arrivedS - stampS];
    })
    .toSorted((a, b) => a - b);
  const median = latencies[Math.floor(latencies.length / 2)];
  return median === undefined || median < EARLIEST_S || median > LONGEST_LATENCY_S ? null : Math.max(0, median);
}

/** Where images come from: the camera, or a recording. */
export interface ImageFeed {
  start(): void;
  close(): void;
  /** Ask for the images anew. */
  reload(): void;
  /** Images a second; null where that is not known. */
  rate(nowMs: number): number | null;
}

export class CameraStream implements ImageFeed {
  private abort: AbortController | null = null;
  private arrivalsMs: number[] = [];
  private waiting: { jpeg: Blob; stampS: number | null; receivedMs: number } | null = null;
  private isDecoding = false;
  private timer: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly topic: string,
    private readonly listener: StreamListener,
  ) {}

  start(): void {
    document.addEventListener("visibilitychange", this.onVisibility);
    this.onVisibility();
  }

  close(): void {
    document.removeEventListener("visibilitychange", this.onVisibility);
    this.end();
  }

  reload(): void {
    this.end();
    this.onVisibility();
  }

  rate(nowMs: number): number | null {
    return arrivalRate(this.arrivalsMs, nowMs);
  }

  private onVisibility = (): void => {
    if (document.hidden) {
      this.end();
      this.listener.state({ kind: "hidden" });
    } else if (this.abort === null) void this.open();
  };

  private end(): void {
    clearTimeout(this.timer);
    this.abort?.abort();
    this.abort = null;
    this.waiting = null;
    this.arrivalsMs = [];
  }

  private async open(): Promise<void> {
    const abort = new AbortController();
    this.abort = abort;
    this.listener.state({ kind: "opening" });
    let outcome: StreamState;
    try {
      const response = await request(`/_video/stream?topic=${encodeURIComponent(this.topic)}`, { signal: abort.signal });
      if (response.ok && response.body !== null) {
        await this.read(response.body, abort.signal);
        outcome = { kind: "lost", retryMs: 0 };
      } else outcome = { kind: "refused", reason: (await response.text()).trim().slice(0, 300), retryMs: 0 };
    } catch (error) {
      outcome = error instanceof MalformedStream ? { kind: "refused", reason: error.message, retryMs: 0 } : { kind: "lost", retryMs: 0 };
    }
    if (abort.signal.aborted) return;
    abort.abort();
    this.arrivalsMs = [];
    this.listener.state({ ...outcome, retryMs: performance.now() + RETRY_MS });
    this.timer = setTimeout(() => void this.open(), RETRY_MS);
  }

  private async read(body: ReadableStream<Uint8Array>, signal: AbortSignal): Promise<void> {
    const parts = new PartReader();
    const reader = body.getReader();
    for (;;) {
      const silence = setTimeout(() => void reader.cancel(), SILENT_MS);
      const { done, value } = await reader.read().finally(() => clearTimeout(silence));
      if (done || signal.aborted) return;
      // Of several images that arrived together, only the newest is shown.
      const newest = parts.feed(value).at(-1);
      if (newest === undefined) continue;
      const receivedMs = performance.now();
      this.arrivalsMs = [...this.arrivalsMs.filter((arrival) => receivedMs - arrival <= RATE_WINDOW_MS), receivedMs];
      this.waiting = { jpeg: new Blob([newest.jpeg], { type: "image/jpeg" }), stampS: newest.stampS, receivedMs };
      void this.decode();
    }
  }

  private async decode(): Promise<void> {
    if (this.isDecoding) return;
    this.isDecoding = true;
    while (this.waiting !== null) {
      const { jpeg, stampS, receivedMs } = this.waiting;
      this.waiting = null;
      try {
        const bitmap = await createImageBitmap(jpeg);
        if (this.abort === null) bitmap.close();
        else {
          this.listener.state({ kind: "live" });
          this.listener.image({ bitmap, stampS, receivedMs });
        }
      } catch {
        // A damaged image is passed over: the next one follows.
      }
    }
    this.isDecoding = false;
  }
}
