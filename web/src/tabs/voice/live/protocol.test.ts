import { describe, expect, it } from "vitest";
import { FUNCTION_DECLARATIONS } from "@/generated/voice_tools";
import { audioMessage, setupMessage, textMessage } from "./client_messages";
import { judgeClose } from "./closes";
import { MODEL_NAMES, liveModel } from "./models";
import { BadFrame, readFrame } from "./server_frame";

interface Setup {
  setup: {
    model: string;
    tools: { functionDeclarations: { name: string; behavior?: string }[] }[];
    realtimeInputConfig: { automaticActivityDetection: object };
    sessionResumption?: object;
  };
}

const setup = (name: string, handle: string | null = null) => (setupMessage(liveModel(name), "be brief", handle) as Setup).setup;

describe("the models", () => {
  it("are found with and without their prefix", () => {
    expect(MODEL_NAMES.map((name) => liveModel(name.replace("models/", "")).name)).toEqual(MODEL_NAMES);
  });

  it("that are not in the table are taken for recent ones", () => {
    expect(liveModel(" gemini-9-live ")).toMatchObject({ name: "models/gemini-9-live", declaresBlocking: true });
  });

  it("wait for a function where that must be declared", () => {
    const behaviors = (name: string) => new Set(setup(name).tools[0]?.functionDeclarations.map(({ behavior }) => behavior));
    expect(behaviors("gemini-3.8-live")).toEqual(new Set(["BLOCKING"]));
    expect(behaviors("gemini-3.1-flash-live-preview")).toEqual(new Set([undefined]));
  });
});

describe("the setup", () => {
  it("declares every tool of the table", () => {
    expect(setup("gemini-3.8-live").tools[0]?.functionDeclarations.map(({ name }) => name)).toEqual(FUNCTION_DECLARATIONS.map(({ name }) => name));
  });

  it("leaves the ends of turns to the page", () => {
    expect(setup("gemini-3.8-live").realtimeInputConfig.automaticActivityDetection).toEqual({ disabled: true });
  });

  it("goes on with an earlier conversation by its handle", () => {
    expect(setup("gemini-3.8-live").sessionResumption).toEqual({});
    expect(setup("gemini-3.8-live", "h").sessionResumption).toEqual({ handle: "h" });
  });
});

it("messages carry audio at 16 kHz and complete turns in writing", () => {
  expect(audioMessage("AAA=")).toEqual({ realtimeInput: { audio: { data: "AAA=", mimeType: "audio/pcm;rate=16000" } } });
  expect(textMessage("hello")).toEqual({ clientContent: { turns: [{ role: "user", parts: [{ text: "hello" }] }], turnComplete: true } });
});

describe("a frame of the server", () => {
  it("may hold several things at once, as bytes too", () => {
    const message = {
      serverContent: {
        modelTurn: { parts: [{ text: "thought" }, { inlineData: { mimeType: "audio/pcm;rate=24000", data: "AAAA" } }] },
        outputTranscription: { text: "Hi" },
        turnComplete: true,
      },
      goAway: { timeLeft: "9.5s" },
      sessionResumptionUpdate: { newHandle: "h", resumable: true },
    };
    const bytes = new TextEncoder().encode(JSON.stringify(message)).buffer as ArrayBuffer;
    for (const data of [JSON.stringify(message), bytes]) {
      expect(readFrame(data)).toMatchObject({ audio: [{ data: "AAAA", rateHz: 24_000 }], said: "Hi", isTurnComplete: true, endsInMs: 9500, handle: "h" });
    }
  });

  it("has calls with an id and a name only", () => {
    const calls = [{ id: "1", name: "stop" }, { name: "stop" }, { id: "2", name: "" }, null, { id: "3", name: "drive", args: [1] }];
    expect(readFrame(JSON.stringify({ toolCall: { functionCalls: calls } })).calls).toEqual([
      { id: "1", name: "stop", args: {} },
      { id: "3", name: "drive", args: {} },
    ]);
  });

  it("without a handle that can be used has none", () => {
    expect(readFrame('{"sessionResumptionUpdate":{"newHandle":"h","resumable":false}}').handle).toBeNull();
  });

  it("that is none is refused", () => {
    for (const data of ["", "{", "[]", "null", "1", 5, null, "x".repeat(9_000_000)]) expect(() => readFrame(data)).toThrow(BadFrame);
  });

  it("of any other shape is empty", () => {
    for (const text of ["{}", '{"serverContent":7}', '{"serverContent":{"modelTurn":{"parts":"x"}}}', '{"toolCall":{"functionCalls":{}}}', '{"toolCallCancellation":{"ids":[3,""]}}']) {
      expect(readFrame(text)).toMatchObject({ audio: [], calls: [], cancelled: [], isTurnComplete: false, endsInMs: null });
    }
  });
});

describe("a closed connection", () => {
  const judged = (code: number, reason = "", isResuming = false) => {
    const { next, error } = judgeClose(code, reason, isResuming);
    return [next, error.phrase?.key];
  };

  it("is explained by its reason before its code", () => {
    expect(judged(1007, "API key not valid. Please pass a valid API key.")).toEqual(["fail", "voice_fail_key"]);
    expect(judged(1011, "You exceeded your current quota")).toEqual(["fail", "voice_fail_quota"]);
    expect(judged(1008, "models/x is not found for API version v1beta, or is not supported for bidiGenerateContent")).toEqual(["fail", "voice_fail_model"]);
    expect(judged(1008, "token has expired")).toEqual(["retry", "voice_fail_token"]);
  });

  it("begins anew where the old conversation is refused", () => {
    expect(judged(1007, "Request contains an invalid argument.", true)).toEqual(["renew", "voice_fail_refused"]);
    expect(judged(1007, "Request contains an invalid argument.")).toEqual(["fail", "voice_fail_refused"]);
  });

  it("is tried again after a failure of the service or the network", () => {
    expect(judged(1011, "Deadline expired before operation could complete.")).toEqual(["retry", "voice_fail_service"]);
    expect(judged(1006)).toEqual(["retry", "voice_fail_offline"]);
  });
});
