/** The messages that the page sends to the Live API (https://ai.google.dev/api/live). */
import { FUNCTION_DECLARATIONS } from "@/generated/voice_tools";
import type { LiveModel } from "./models";

export const INPUT_RATE_HZ = 16_000;

export interface FunctionResponse {
  id: string;
  name: string;
  response: Record<string, unknown>;
}

/** The first message of a connection. With a `handle`, it goes on with the conversation of an earlier one. */
export function setupMessage(model: LiveModel, instruction: string, handle: string | null): object {
  const declarations = FUNCTION_DECLARATIONS.map((declaration) => (model.declaresBlocking ? { ...declaration, behavior: "BLOCKING" } : declaration));
  return {
    setup: {
      model: model.name,
      // The language is part of the instruction: models that hear and speak by themselves refuse a languageCode.
      generationConfig: { responseModalities: ["AUDIO"] },
      systemInstruction: { parts: [{ text: instruction }] },
      tools: [{ functionDeclarations: declarations }],
      // Only the page says when a turn begins and ends: a second detection would add its own silence to every answer.
      realtimeInputConfig: {
        automaticActivityDetection: { disabled: true },
        activityHandling: "START_OF_ACTIVITY_INTERRUPTS",
        turnCoverage: "TURN_INCLUDES_ONLY_ACTIVITY",
      },
      inputAudioTranscription: {},
      outputAudioTranscription: {},
      ...(model.canResume ? { sessionResumption: handle === null ? {} : { handle } } : {}),
      ...(model.canCompress ? { contextWindowCompression: { slidingWindow: {} } } : {}),
    },
  };
}

export const ACTIVITY_START = { realtimeInput: { activityStart: {} } };
export const ACTIVITY_END = { realtimeInput: { activityEnd: {} } };

/** Audio of an utterance: PCM of 16 bits, in base64. */
export function audioMessage(data: string): object {
  return { realtimeInput: { audio: { data, mimeType: `audio/pcm;rate=${INPUT_RATE_HZ}` } } };
}

/** A complete turn in writing. The model ends what it is saying, and answers. */
export function textMessage(text: string): object {
  return { clientContent: { turns: [{ role: "user", parts: [{ text }] }], turnComplete: true } };
}

export function responseMessage(functionResponses: readonly FunctionResponse[]): object {
  return { toolResponse: { functionResponses } };
}
