/** Requests to the console's API. */
import { IS_MOCK } from "@/environment";

export class ApiError extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
}

const TIMEOUT_MS = 15_000;

/** The mock mode's server, which answers in place of the network; null outside of it, where its chunk is never loaded. */
const mock = IS_MOCK ? import("@/mock/mock") : null;

/** `fetch` for paths of this origin. All requests go through it, so that the mock mode can answer them. */
export async function request(path: string, options?: RequestInit): Promise<Response> {
  return mock === null ? fetch(path, options) : (await mock).answer(path, options);
}

/** GET a resource, or POST `body` to it, and return the JSON of the answer. Throws ApiError with the server's reason. */
export async function ask<Answer>(path: string, body?: unknown, timeoutMs = TIMEOUT_MS): Promise<Answer> {
  const options: RequestInit = { signal: AbortSignal.timeout(timeoutMs) };
  if (body !== undefined) {
    options.method = "POST";
    options.headers = { "Content-Type": "application/json" };
    options.body = JSON.stringify(body);
  }
  let response: Response;
  try {
    response = await request(path, options);
  } catch (error) {
    throw new ApiError(0, error instanceof DOMException ? "the console's server does not answer" : "no link to the console's server");
  }
  const text = await response.text();
  const isJson = response.headers.get("Content-Type")?.startsWith("application/json") ?? false;
  const answer: unknown = isJson ? JSON.parse(text) : { error: text.trim() };
  if (!response.ok) throw new ApiError(response.status, reason(answer) ?? `the server answered with status ${response.status}`);
  return answer as Answer;
}

function reason(answer: unknown): string | null {
  if (typeof answer !== "object" || answer === null) return null;
  const { error } = answer as { error?: unknown };
  return typeof error === "string" && error !== "" ? error : null;
}
