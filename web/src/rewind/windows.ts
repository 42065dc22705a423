/** Windows of the recording: what the console's server sends of some seconds, decoded, and the last ones of them. */
import { decodeSequence } from "cbor2";
import { refused, request, unanswered } from "@/api/http";

/** The seconds that are asked for at once. */
export const WINDOW_S = 10;
/** How much earlier the samples begin: transforms and poses up to the window's first moment. */
export const LEAD_S = 1;
const KEPT = 8;
const MAX_PARTS = 6;
const TIMEOUT_MS = 20_000;

export interface RecordedSample {
  topic: string;
  /** When it arrived at the recorder, s of the robot's clock. */
  atS: number;
  message: unknown;
}

export interface Answer {
  startS: number;
  endS: number;
  /** Up to here, all samples are there. */
  completeS: number;
  samples: RecordedSample[];
}

export interface Window extends Answer {
  /** The first moment that can be shown from it. */
  fromS: number;
  topics: ReadonlySet<string>;
}

export class MalformedWindow extends Error {}

/** Decode an answer of `/_api/runs/ID/recording/window`. Throws MalformedWindow. */
export function parseAnswer(bytes: Uint8Array): Answer {
  try {
    const [head, ...items] = [...decodeSequence(bytes)] as [Record<string, unknown>, ...unknown[]];
    const [startS, endS, completeS] = [head["start_s"], head["end_s"], head["complete_s"]].map(Number) as [number, number, number];
    if (![startS, endS, completeS].every(Number.isFinite)) throw new MalformedWindow("the recording's times are missing");
    const samples = items.map((item) => {
      const [topic, atS, message] = item as [string, number, unknown];
      return { topic: String(topic), atS: Number(atS), message };
    });
    return { startS, endS, completeS, samples };
  } catch (error) {
    throw error instanceof MalformedWindow ? error : new MalformedWindow("the recording's samples cannot be read");
  }
}

export type Load = (query: { fromS: number; toS: number; topics: readonly string[] } | null, signal: AbortSignal) => Promise<Answer>;

/** The function that loads windows of a run; with null, the recording's times only. It throws ApiError and MalformedWindow. */
export function loadFrom(run: string): Load {
  return async (query, signal) => {
    const asked = query === null ? "" : `?from=${query.fromS.toFixed(3)}&to=${query.toS.toFixed(3)}&topics=${query.topics.map(encodeURIComponent).join(",")}`;
    let response: Response;
    try {
      response = await request(`/_api/runs/${encodeURIComponent(run)}/recording/window${asked}`, {
        signal: AbortSignal.any([signal, AbortSignal.timeout(TIMEOUT_MS)]),
      });
    } catch (error) {
      if (signal.aborted) throw error;
      throw unanswered(error);
    }
    if (!response.ok) throw refused(response.status, (await response.text()).trim().slice(0, 300));
    return parseAnswer(new Uint8Array(await response.arrayBuffer()));
  };
}

/** The windows that were loaded last. A moment has one where all of its samples were loaded, for all topics. */
export class Windows {
  private kept: Window[] = [];

  constructor(private readonly load: Load) {}

  find(atS: number, topics: readonly string[]): Window | undefined {
    return this.kept.find((window) => window.fromS <= atS && atS <= window.completeS && topics.every((topic) => window.topics.has(topic)));
  }

  /** Load the window of a moment. Throws what `load` throws. */
  async open(atS: number, topics: readonly string[], signal: AbortSignal): Promise<Window> {
    let fromS = Math.floor(atS / WINDOW_S) * WINDOW_S;
    const toS = fromS + WINDOW_S;
    for (let part = 1; ; part += 1) {
      const answer = await this.load({ fromS: Math.max(0, fromS - LEAD_S), toS, topics }, signal);
      // The server cuts windows that are too large: what follows is a window of its own, unless nothing came of it.
      const isWhole = answer.completeS >= Math.min(atS, answer.endS) || answer.completeS <= fromS || part === MAX_PARTS;
      if (!isWhole) {
        fromS = answer.completeS;
        continue;
      }
      const window: Window = { ...answer, completeS: Math.max(answer.completeS, atS), fromS, topics: new Set(topics) };
      // An older window of the same seconds lacks what was recorded since, or topics.
      this.kept = [...this.kept.filter((each) => each.fromS !== fromS), window].slice(-KEPT);
      return window;
    }
  }
}
