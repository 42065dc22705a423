/** The images of a camera at the shown moment of a recording. */
import type { sensor_msgs_CompressedImage } from "@/generated/messages";
import type { TopicStore } from "@/ros/topics";
import type { ImageFeed, StreamListener } from "./camera_stream";

export class RecordedImages implements ImageFeed {
  private end = () => {};
  private waiting: { message: sensor_msgs_CompressedImage; receivedMs: number } | null = null;
  private isDecoding = false;
  private isClosed = false;

  constructor(
    private readonly store: TopicStore,
    private readonly topic: string,
    private readonly listener: StreamListener,
  ) {}

  start(): void {
    const row = { name: `${this.topic}/compressed`, type: "sensor_msgs/msg/CompressedImage" } as const;
    const take = () => {
      const sample = this.store.last(row);
      this.waiting = sample ?? null;
      if (sample !== undefined) void this.decode();
      // The samples of another moment follow at once, if there are any.
      else queueMicrotask(() => !this.isClosed && this.store.last(row) === undefined && this.listener.state({ kind: "missing" }));
    };
    this.end = this.store.listen(row, {}, take);
    take();
  }

  close(): void {
    this.isClosed = true;
    this.end();
  }

  reload(): void {}

  /** Of single images there is no rate. */
  rate(): number | null {
    return null;
  }

  private async decode(): Promise<void> {
    if (this.isDecoding) return;
    this.isDecoding = true;
    while (this.waiting !== null) {
      const { message, receivedMs } = this.waiting;
      this.waiting = null;
      try {
        const { sec, nanosec } = message.header.stamp;
        const bitmap = await createImageBitmap(new Blob([new Uint8Array(message.data)]));
        if (this.isClosed) bitmap.close();
        else {
          this.listener.state({ kind: "live" });
          this.listener.image({ bitmap, stampS: sec + nanosec / 1e9, receivedMs });
        }
      } catch {
        // A damaged image is passed over: the next one follows.
      }
    }
    this.isDecoding = false;
  }
}
