/** The mock recording: the last minutes of what the robot published, and windows of it as the console's server sends them. */
import { encode } from "cbor2";
import { TOPICS } from "@/generated/graph";
import { RequestRefused } from "./authority";
import { header } from "./messages";
import { SAMPLES, type SampleRow } from "./samples";
import { SOURCES, jpegOf } from "./video";
import type { Camera } from "./view";
import type { World } from "./world";

const KEPT_S = 180;
const MAX_WINDOW_S = 30;
const IMAGE_HZ = 1;
/** How often each topic is recorded, in Hz; no row is made here that takes something from the world. */
const RATES = new Map<string, number>(
  (
    [
      [TOPICS.TF, 10],
      [TOPICS.TF_STATIC, 0.1],
      [TOPICS.ODOM, 10],
      [TOPICS.SCAN, 5],
      [TOPICS.JOINT_STATES, 5],
      [TOPICS.PLAN, 2],
      [TOPICS.MAP, 0.1],
      [TOPICS.MISSION_STATE, 2],
      [TOPICS.TWIN_STATE, 1],
      [TOPICS.BOX_GEOMETRY, 0.1],
      [TOPICS.ESTOP_STATE, 2],
      [TOPICS.TAG_DETECTIONS, 5],
      [TOPICS.FLOWER_DETECTIONS, 2],
    ] as const
  ).map(([{ name }, rateHz]) => [name, rateHz]),
);

interface Recorded {
  topic: string;
  atS: number;
  message: unknown;
  /** In place of a message: what a camera looked at, of which the image is drawn once it is asked for. */
  camera?: Camera;
}

export class MockRecording {
  private samples: Recorded[] = [];
  private dueS = new Map<string, number>();

  constructor(private readonly world: World) {}

  /** Record what is due. */
  record(): void {
    const { clockS, options } = this.world;
    if (options.clockS !== null || options.faults.has("none")) return;
    for (const row of SAMPLES) {
      const rateHz = RATES.get(row.name);
      if (rateHz !== undefined && this.isDue(row.name, rateHz, clockS)) this.add(row, clockS);
    }
    if (options.faults.has("nocamera")) return;
    for (const { topic, view } of SOURCES) {
      if (this.isDue(topic, IMAGE_HZ, clockS)) this.samples.push({ topic: `${topic}/compressed`, atS: clockS, message: null, camera: view(this.world) });
    }
    if (this.samples.length > 0 && (this.samples[0]?.atS ?? 0) < clockS - 1.2 * KEPT_S) {
      this.samples = this.samples.filter(({ atS }) => atS >= clockS - KEPT_S);
    }
  }

  /** The body of an answer to a request for a window. Throws RequestRefused. */
  async window(query: URLSearchParams): Promise<Uint8Array<ArrayBuffer>> {
    const [startS, endS] = [this.samples[0]?.atS ?? 0, this.samples.at(-1)?.atS ?? 0];
    const topics = (query.get("topics") ?? "").split(",").filter((name) => name !== "");
    const [fromS, toS] = topics.length === 0 ? [0, 0] : [Number(query.get("from")), Number(query.get("to"))];
    if (!(fromS >= 0 && toS >= fromS && toS - fromS <= MAX_WINDOW_S)) throw new RequestRefused(`to must be up to ${MAX_WINDOW_S} s after from`, 400);
    const last = new Map<string, Recorded>();
    const within: Recorded[] = [];
    for (const sample of this.samples) {
      if (!topics.includes(sample.topic) || sample.atS > toS) continue;
      if (sample.atS < fromS) last.set(sample.topic, sample);
      else within.push(sample);
    }
    const items: unknown[] = [{ start_s: startS, end_s: endS, complete_s: Math.min(toS, endS) }];
    for (const { topic, atS, message, camera } of [...last.values(), ...within]) {
      items.push([topic, atS, camera === undefined ? message : await image(camera, atS)]);
    }
    return new Uint8Array(await new Blob(items.map((item) => new Uint8Array(encode(item)))).arrayBuffer());
  }

  private isDue(name: string, rateHz: number, clockS: number): boolean {
    if (clockS < (this.dueS.get(name) ?? 0)) return false;
    this.dueS.set(name, clockS + 1 / rateHz);
    return true;
  }

  private add(row: SampleRow, atS: number): void {
    for (const message of row.make(this.world)) this.samples.push({ topic: row.name, atS, message });
  }
}

async function image(camera: Camera, atS: number): Promise<unknown> {
  return { header: header(atS, "camera"), format: "jpeg", data: new Uint8Array(await jpegOf(camera)) };
}
