/** The one word for what the voice agent does now, by which the tab shows it. */
import type { VoiceView } from "./voice_store";

export type VoiceState =
  | "off"
  | "scripted_only"
  | "failed"
  | "connecting"
  | "link_lost"
  | "refused"
  | "hearing"
  | "thinking"
  | "speaking"
  | "stopped"
  | "listening"
  | "typing";

export interface StateFacts {
  view: Pick<VoiceView, "session" | "isConsoleOpen" | "console" | "failure" | "isOperatorSpeaking" | "isThinking" | "isAgentSpeaking" | "microphone" | "isTypedOnly" | "isScripted">;
  /** Whether a model can be reached: the console or this browser has a key. */
  hasKey: boolean;
  /** Whether the robot is stopped. */
  isStopped: boolean;
  /** Whether this page's link to the robot is lost. */
  isLinkLost: boolean;
}

export function voiceState({ view, hasKey, isStopped, isLinkLost }: StateFacts): VoiceState {
  if (view.session === "off" && isLinkLost) return "link_lost";
  if (view.session === "off") return view.failure !== null ? "failed" : hasKey ? "off" : "scripted_only";
  if (view.session === "connecting") return "connecting";
  if (!view.isConsoleOpen || isLinkLost) return "link_lost";
  if (view.isOperatorSpeaking) return "hearing";
  if ((view.console?.cutOff ?? "") !== "") return "refused";
  if (view.isAgentSpeaking) return "speaking";
  if (view.isThinking) return "thinking";
  if (isStopped) return "stopped";
  return (view.microphone === "on" && !view.isTypedOnly) || view.isScripted ? "listening" : "typing";
}
