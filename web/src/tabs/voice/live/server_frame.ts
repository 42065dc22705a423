/** What the Live API sends, checked. One frame may hold several things at once, such as audio and a part of a transcript. */

const MAX_CHARACTERS = 8_000_000;
const MAX_CALLS = 50;
const MAX_NAME = 200;
const OUTPUT_RATE_HZ = 24_000;

export interface FunctionCall {
  id: string;
  name: string;
  args: Record<string, unknown>;
}

export interface AudioChunk {
  /** PCM of 16 bits, in base64. */
  data: string;
  rateHz: number;
}

export interface ServerFrame {
  isSetupComplete: boolean;
  audio: AudioChunk[];
  /** The next part of what was heard of the operator. */
  heard: string;
  /** The next part of what the model says. */
  said: string;
  isInterrupted: boolean;
  isTurnComplete: boolean;
  calls: FunctionCall[];
  /** Calls that the model no longer wants. */
  cancelled: string[];
  /** How long the connection still lasts, ms; null where nothing was said. */
  endsInMs: number | null;
  /** By what a later connection goes on with this conversation; null where nothing was said, or it cannot now. */
  handle: string | null;
}

/** A frame that is none of the Live API. */
export class BadFrame extends Error {}

type Fields = Record<string, unknown>;

/** Read a frame. Throws BadFrame; fields that are not known are passed over. */
export function readFrame(data: unknown): ServerFrame {
  const text = typeof data === "string" ? data : data instanceof ArrayBuffer ? new TextDecoder().decode(data) : null;
  if (text === null || text.length > MAX_CHARACTERS) throw new BadFrame("neither text nor bytes of it, or too long");
  let parsed: unknown;
  try {
    parsed = JSON.parse(text);
  } catch {
    throw new BadFrame("not JSON");
  }
  const message = fields(parsed);
  if (message === null) throw new BadFrame("not an object");
  const content = fields(message["serverContent"]) ?? {};
  const resumption = fields(message["sessionResumptionUpdate"]);
  const goAway = fields(message["goAway"]);
  return {
    isSetupComplete: fields(message["setupComplete"]) !== null,
    audio: readAudio(content),
    heard: transcript(content["inputTranscription"]),
    said: transcript(content["outputTranscription"]),
    isInterrupted: content["interrupted"] === true,
    isTurnComplete: content["turnComplete"] === true,
    calls: readCalls(message["toolCall"]),
    cancelled: list(fields(message["toolCallCancellation"])?.["ids"]).filter(isName),
    endsInMs: goAway === null ? null : durationMs(goAway["timeLeft"]),
    handle: resumption?.["resumable"] === true && typeof resumption["newHandle"] === "string" && resumption["newHandle"] !== "" ? resumption["newHandle"] : null,
  };
}

function readAudio(content: Fields): AudioChunk[] {
  const chunks: AudioChunk[] = [];
  for (const part of list(fields(content["modelTurn"])?.["parts"])) {
    const inline = fields(fields(part)?.["inlineData"]);
    const { data, mimeType } = inline ?? {};
    if (typeof data !== "string" || typeof mimeType !== "string" || !/^audio\/(pcm|l16)\b/i.test(mimeType)) continue;
    const rate = Number(/rate=(\d+)/.exec(mimeType)?.[1] ?? OUTPUT_RATE_HZ);
    // What an AudioBuffer takes.
    if (rate >= 8000 && rate <= 96_000) chunks.push({ data, rateHz: rate });
  }
  return chunks;
}

function readCalls(toolCall: unknown): FunctionCall[] {
  const calls: FunctionCall[] = [];
  for (const each of list(fields(toolCall)?.["functionCalls"]).slice(0, MAX_CALLS)) {
    const { id, name, args } = fields(each) ?? {};
    // A call without an id cannot be answered.
    if (isName(id) && isName(name)) calls.push({ id, name, args: fields(args) ?? {} });
  }
  return calls;
}

/** A duration of protobuf's JSON, such as "9.5s"; one that cannot be read is over. */
function durationMs(value: unknown): number {
  const seconds = typeof value === "string" ? Number(/^(\d+(?:\.\d+)?)s$/.exec(value)?.[1]) : NaN;
  return Number.isFinite(seconds) ? seconds * 1000 : 0;
}

function transcript(value: unknown): string {
  const text = fields(value)?.["text"];
  return typeof text === "string" ? text : "";
}

function isName(value: unknown): value is string {
  return typeof value === "string" && value !== "" && value.length <= MAX_NAME;
}

function fields(value: unknown): Fields | null {
  return typeof value === "object" && value !== null && !Array.isArray(value) ? (value as Fields) : null;
}

function list(value: unknown): unknown[] {
  return Array.isArray(value) ? value : [];
}
