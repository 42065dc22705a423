import { describe, expect, it } from "vitest";
import { type StateFacts, voiceState } from "./view_state";
import { EMPTY_VIEW, type VoiceView } from "./voice_store";

const ON: Partial<VoiceView> = { session: "on", isConsoleOpen: true, microphone: "on" };
const CONSOLE = { cutOff: "", speedCap: 1, maxLinearMps: 0.3, maxAngularRps: 0.8, isDriving: false, listener: { state: "off" as const, reason: "" } };
const state = (view: Partial<VoiceView>, facts: Partial<StateFacts> = {}) => voiceState({ view: { ...EMPTY_VIEW, ...view }, hasKey: true, isStopped: false, isLinkLost: false, ...facts });

describe("the state of the voice agent", () => {
  it("before it is started says what is missing", () => {
    expect(state({})).toBe("off");
    expect(state({}, { hasKey: false })).toBe("scripted_only");
    expect(state({ failure: new Error("quota") })).toBe("failed");
    expect(state({}, { isLinkLost: true })).toBe("link_lost");
  });

  it("follows the turn", () => {
    expect(state({ session: "connecting" })).toBe("connecting");
    expect(state(ON)).toBe("listening");
    expect(state({ ...ON, microphone: "off" })).toBe("typing");
    expect(state({ ...ON, isTypedOnly: true })).toBe("typing");
    expect(state({ ...ON, microphone: "off", isScripted: true })).toBe("listening");
    expect(state({ ...ON, isOperatorSpeaking: true })).toBe("hearing");
    expect(state({ ...ON, isThinking: true })).toBe("thinking");
    expect(state({ ...ON, isAgentSpeaking: true, isThinking: true })).toBe("speaking");
  });

  it("says why nothing is carried out", () => {
    expect(state({ ...ON, isConsoleOpen: false })).toBe("link_lost");
    expect(state(ON, { isLinkLost: true })).toBe("link_lost");
    expect(state({ ...ON, console: { ...CONSOLE, cutOff: "it called too much" } })).toBe("refused");
    expect(state(ON, { isStopped: true })).toBe("stopped");
  });
});
