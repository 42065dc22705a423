// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import { type VoiceFacts, requirements } from "./requirements";

const ALL: VoiceFacts = { by: "console", isKeyKept: true, isSecure: true, hasMicrophone: true };
const states = (facts: Partial<VoiceFacts>) => requirements({ ...ALL, ...facts }).map(({ state }) => state);

describe("what voice needs", () => {
  it("is all there", () => {
    expect(requirements(ALL).every(({ isMet }) => isMet)).toBe(true);
  });

  it("is named where it is missing", () => {
    expect(states({ by: "script" })[0]).toBe("voice_key_none");
    expect(states({ by: "offline" })[0]).toBe("voice_key_offline");
    expect(states({ by: "browser", isKeyKept: false })[0]).toBe("voice_key_page_only");
    expect(states({ isSecure: false, hasMicrophone: false })[1]).toBe("voice_not_secure");
    expect(states({ hasMicrophone: false })[1]).toBe("voice_microphone_none");
  });
});
