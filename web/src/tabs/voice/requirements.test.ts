import { describe, expect, it } from "vitest";
import { requirements } from "./requirements";

const ALL = { hasKey: true, isKeyKept: true, isSecure: true, hasMicrophone: true, hasEngine: true };
const states = (facts: Partial<typeof ALL>) => requirements({ ...ALL, ...facts }).map(({ state }) => state);

describe("what voice needs", () => {
  it("is all there", () => {
    expect(requirements(ALL).every(({ isMet }) => isMet)).toBe(true);
  });

  it("is named where it is missing", () => {
    expect(states({ hasKey: false })[0]).toBe("voice_key_none");
    expect(states({ isKeyKept: false })[0]).toBe("voice_key_page_only");
    expect(states({ isSecure: false, hasMicrophone: false })[1]).toBe("voice_not_secure");
    expect(states({ hasMicrophone: false })[1]).toBe("voice_microphone_none");
    expect(states({ hasEngine: false })[2]).toBe("voice_engine_none");
  });
});
