/** Why the Live API has closed a connection, and what to do. */
import { TextError } from "@/i18n/text_error";

export interface Close {
  /** Connect again, connect again without the conversation so far, or give up. */
  next: "retry" | "renew" | "fail";
  /** What to tell the operator if it does not work out. */
  error: TextError;
}

const MAX_REASON = 160;

/** `isResuming`: the connection asked for the conversation of an earlier one, and had not been set up yet. */
export function judgeClose(code: number, reason: string, isResuming: boolean): Close {
  const has = (pattern: RegExp) => pattern.test(reason);
  const said = { reason: reason.slice(0, MAX_REASON) || `${code}` };
  if (has(/api[ _]?key|unauthenticated|permission[ _]denied|invalid authentication/i)) return { next: "fail", error: new TextError("voice_fail_key") };
  if (has(/quota|resource[ _]exhausted|billing|rate limit/i)) return { next: "fail", error: new TextError("voice_fail_quota") };
  if (has(/not found|not supported for bidi/i) && has(/model/i)) return { next: "fail", error: new TextError("voice_fail_model") };
  if (has(/token/i) && has(/expired|used|invalid/i)) return { next: "retry", error: new TextError("voice_fail_token") };
  if (isResuming && (code === 1007 || code === 1008)) return { next: "renew", error: new TextError("voice_fail_refused", said) };
  if (code === 1007 || code === 1008 || code === 1003 || code === 1002) return { next: "fail", error: new TextError("voice_fail_refused", said) };
  if (code === 1011) return { next: "retry", error: new TextError("voice_fail_service", said) };
  return { next: "retry", error: new TextError("voice_fail_offline") };
}
