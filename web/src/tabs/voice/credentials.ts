/** What answers the operator: a model, by a token of the console or a key of this browser; the console itself; or a script. */
import { create } from "zustand";
import { getJson, postJson } from "@/api/http";
import { type MessageSocket, openScriptedAgent, openSocket } from "@/api/sockets";
import { IS_MOCK } from "@/environment";
import { TextError } from "@/i18n/text_error";
import { useSetting } from "@/state/settings";
import { useVoiceKey } from "./voice_key";

export type Credential = "console" | "browser" | "offline" | "script";

const SERVICE_URL = "wss://generativelanguage.googleapis.com/ws/google.ai.generativelanguage.v1beta.GenerativeService.BidiGenerateContent";

/** Whether the console keeps a key; null until it has said so. `problem`: why it could not say. */
export const useConsoleKey = create<{ isStored: boolean | null; problem: Error | null }>(() => ({ isStored: null, problem: null }));

/** Ask the console whether it keeps a key. One that does not answer has none to offer. */
export async function loadConsoleKey(): Promise<void> {
  try {
    const answer = await getJson<{ stored: unknown }>("/_api/voice/key");
    useConsoleKey.setState({ isStored: answer.stored === true, problem: null });
  } catch (error) {
    useConsoleKey.setState({ isStored: false, problem: error instanceof Error ? error : new Error(String(error)) });
  }
}

/**
 * The console's key comes first: it never leaves that computer. Without a key, or where the operator chose so, the console itself
 * understands a grammar. No model is reached from the mock mode.
 */
export function credential(engine: string, isStoredByConsole: boolean | null, browserKey: string, isMock = IS_MOCK): Credential {
  if (isMock) return "script";
  if (engine === "offline") return "offline";
  if (isStoredByConsole === true) return "console";
  return browserKey !== "" ? "browser" : "offline";
}

export function useCredential(): Credential {
  const isStored = useConsoleKey((store) => store.isStored);
  const key = useVoiceKey((store) => store.key);
  return credential(useSetting("voiceEngine"), isStored, key);
}

/** Open a connection to the voice service. Throws ApiError, CommandRefused and TextError with what to tell the operator. */
export async function openLive(by: Credential, model: string): Promise<MessageSocket> {
  if (by === "console") {
    // A token serves one connection, and only this model.
    const { token, url } = await postJson<{ token: string; url: string }>("/_api/voice/token", { model });
    return openSocket(`${url}?access_token=${encodeURIComponent(token)}`);
  }
  if (by === "browser") return openSocket(`${SERVICE_URL}?key=${encodeURIComponent(useVoiceKey.getState().key)}`);
  const scripted = await openScriptedAgent();
  if (scripted === null) throw new TextError("voice_fail_no_key");
  return scripted;
}
