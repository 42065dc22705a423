/** Requests to the console's API. */
import { type Phrase, WordedError } from "@/i18n/text_error";
import { refuseRequest } from "@/safety/guard";

export class ApiError extends WordedError {
  /** `status` is 0 where the server gave no answer; `words` are its own, or a text of the catalog. */
  constructor(
    readonly status: number,
    words: string | Phrase,
  ) {
    super(words);
  }
}

/** The error of a request that got no answer. */
export function unanswered(error: unknown): ApiError {
  return new ApiError(0, { key: error instanceof DOMException ? "error_server_silent" : "error_server_unreachable" });
}

/** The error of an answer that is none: the server's reason, if it gave one. */
export function refused(status: number, words: string | null): ApiError {
  return new ApiError(status, words || { key: "error_status", values: { status } });
}

const TIMEOUT_MS = 15_000;

let answerRequest = (path: string, options?: RequestInit): Promise<Response> => fetch(path, options);

/** Have something else than the network answer all requests, as the mock mode does. */
export function answerRequestsBy(answer: (path: string, options?: RequestInit) => Promise<Response>): void {
  answerRequest = answer;
}

/** `fetch` for paths of this origin. All requests go through it. */
export function request(path: string, options?: RequestInit): Promise<Response> {
  return answerRequest(path, options);
}

/** The JSON of a resource. Throws ApiError with the server's reason. */
export function getJson<Answer>(path: string): Promise<Answer> {
  return requestJson(path, { signal: AbortSignal.timeout(TIMEOUT_MS) });
}

/** Send `body` to a resource, and return the JSON of the answer. Throws ApiError with the server's reason, and CommandRefused. */
export async function postJson<Answer>(path: string, body: unknown, timeoutMs = TIMEOUT_MS): Promise<Answer> {
  refuseRequest(path, body);
  return requestJson(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body), signal: AbortSignal.timeout(timeoutMs) });
}

async function requestJson<Answer>(path: string, options: RequestInit): Promise<Answer> {
  let response: Response;
  try {
    response = await request(path, options);
  } catch (error) {
    throw unanswered(error);
  }
  const text = await response.text();
  const isJson = response.headers.get("Content-Type")?.startsWith("application/json") ?? false;
  const answer: unknown = isJson ? JSON.parse(text) : { error: text.trim() };
  if (!response.ok) throw refused(response.status, reason(answer));
  return answer as Answer;
}

function reason(answer: unknown): string | null {
  if (typeof answer !== "object" || answer === null) return null;
  const { error } = answer as { error?: unknown };
  return typeof error === "string" && error !== "" ? error : null;
}
