/** The mock cameras: their list, and streams of JPEG images as the video server sends them. */
import { TOPICS } from "@/generated/graph";
import { isLost, isSilent, whenLost } from "./link_state";
import { drawImage } from "./camera_image";
import { type Camera, IMAGE, frontCamera, gripperCamera } from "./view";
import type { World } from "./world";

const BOUNDARY = "lupin-frame";
const JPEG_QUALITY = 0.7;
const STALLS_AFTER_MS = 3000;
const TRAVELS_MS = 60;

interface Source {
  topic: string;
  fps: number;
  view: (world: World) => Camera;
}

export const SOURCES: readonly Source[] = [
  { topic: TOPICS.BODY_IMAGE_ROBOT.name, fps: 12, view: frontCamera },
  { topic: TOPICS.GRIPPER_IMAGE.name, fps: 5, view: gripperCamera },
];

/** An image of what a camera looks at. */
export async function jpegOf(camera: Camera): Promise<ArrayBuffer> {
  const canvas = document.createElement("canvas");
  canvas.width = IMAGE.width;
  canvas.height = IMAGE.height;
  const context = canvas.getContext("2d");
  if (context !== null) drawImage(context, camera);
  const blob = await new Promise<Blob | null>((done) => canvas.toBlob(done, "image/jpeg", JPEG_QUALITY));
  return blob === null ? new ArrayBuffer(0) : blob.arrayBuffer();
}

const watched = new Map<string, number>();

function sources({ options }: World): readonly Source[] {
  return options.faults.has("nocamera") ? [] : SOURCES;
}

export function cameraRows(world: World): unknown[] {
  return sources(world).map(({ topic, fps }) => {
    const clients = watched.get(topic) ?? 0;
    return { topic, jpeg: true, clients, fps: clients > 0 ? fps : null, age_s: clients > 0 ? 0.05 : null };
  });
}

/** The answer to a request for a stream: images without end, or the reason why there are none. */
export function videoStream(topic: string, world: World, signal: AbortSignal | null): Response {
  const source = sources(world).find((each) => each.topic === topic);
  if (isLost(world.options)) throw new TypeError("Failed to fetch");
  if (source === undefined) {
    const known = sources(world).map((each) => each.topic);
    return new Response(`no node publishes images on ${topic}; cameras: ${known.join(", ") || "none"}\n`, { status: 404 });
  }
  const canvas = document.createElement("canvas");
  canvas.width = IMAGE.width;
  canvas.height = IMAGE.height;
  const context = canvas.getContext("2d", { willReadFrequently: true });
  let timer: ReturnType<typeof setInterval> | undefined;
  let end = () => {};
  const body = new ReadableStream<Uint8Array>({
    start(controller) {
      watched.set(topic, (watched.get(topic) ?? 0) + 1);
      const beganMs = performance.now();
      let isOpen = true;
      end = () => {
        if (!isOpen) return;
        isOpen = false;
        clearInterval(timer);
        watched.set(topic, (watched.get(topic) ?? 1) - 1);
      };
      controller.enqueue(new TextEncoder().encode(`--${BOUNDARY}\r\n`));
      const shoot = () => {
        const runsMs = performance.now() - beganMs;
        const stalls = world.options.faults.has("stalled") && runsMs > STALLS_AFTER_MS;
        if (context === null || stalls || isSilent(world.options)) return;
        drawImage(context, source.view(world));
        // While time stands still, no image has an age.
        const stamp = world.options.clockS === null ? world.clockS.toFixed(9) : "0";
        const send = (jpeg: ArrayBuffer) => setTimeout(() => isOpen && controller.enqueue(part(jpeg, stamp)), TRAVELS_MS);
        canvas.toBlob((blob) => void blob?.arrayBuffer().then(send), "image/jpeg", JPEG_QUALITY);
      };
      shoot();
      timer = setInterval(shoot, 1000 / source.fps);
      whenLost(world.options, () => {
        if (isOpen) controller.error(new TypeError("network error"));
        end();
      });
      signal?.addEventListener("abort", () => {
        if (isOpen) controller.error(new DOMException("aborted", "AbortError"));
        end();
      });
    },
    cancel: () => end(),
  });
  return new Response(body, { headers: { "Content-Type": `multipart/x-mixed-replace; boundary=${BOUNDARY}` } });
}

function part(jpeg: ArrayBuffer, stamp: string): Uint8Array {
  const head = new TextEncoder().encode(`Content-Type: image/jpeg\r\nX-Timestamp: ${stamp}\r\nContent-Length: ${jpeg.byteLength}\r\n\r\n`);
  const tail = new TextEncoder().encode(`\r\n--${BOUNDARY}\r\n`);
  const bytes = new Uint8Array(head.length + jpeg.byteLength + tail.length);
  bytes.set(head);
  bytes.set(new Uint8Array(jpeg), head.length);
  bytes.set(tail, head.length + jpeg.byteLength);
  return bytes;
}
