/** The scripts of the mock mode, by the parameter `voice` of the page's address: each leads to one state of the Voice tab. */
import type { MessageSocket } from "@/api/sockets";
import type { MockVoice } from "./options";
import { PageSocket } from "./page_socket";
import { type Step, openScriptedAgent, says } from "./scripted_agent";

const REPEATS = 6;

const once = (name: string, args: Record<string, unknown>): Step["call"] => (results) => (results.length === 0 ? { name, args } : null);

const GO_HOME = { name: "nav_goto_named", args: { name: "home" } };

const SCRIPTS: Record<Exclude<MockVoice, "state" | "offline">, readonly Step[]> = {
  confirm: [{ call: (results) => (results.length === 0 ? GO_HOME : null), say: ({ confirm, error }) => (typeof confirm === "string" ? says("voice_says_asks") : typeof error === "string" ? says("voice_says_refused") : says("voice_says_done")) }],
  refused: [{ call: once("drive", { linear_x: 0.2, duration_s: 1 }), say: ({ ok }) => says(ok === true ? "voice_says_done" : "voice_says_refused") }],
  loop: [{ call: (results) => (results.length < REPEATS ? { name: "query_state", args: {} } : null), say: () => says("voice_says_refused") }],
  quota: [{ call: () => null, say: () => "", close: { code: 1011, reason: "You exceeded your current quota, please check your plan and billing details." } }],
  away: [{ call: once("query_state", {}), say: () => says("voice_says_free"), goesAway: true }],
};

/** Open a connection to the script that the page's address asks for. */
export function openMockAgent(voice: MockVoice): MessageSocket {
  if (voice === "state") return openScriptedAgent();
  if (voice !== "offline") return openScriptedAgent(SCRIPTS[voice]);
  return new PageSocket((socket) => {
    setTimeout(() => socket.closeWith(1006, ""), 0);
    return { opened: () => {}, received: () => {}, closed: () => {} };
  });
}
