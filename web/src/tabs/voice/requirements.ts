/** The requirements of voice, and which of them are met. */
import type { TextKey } from "@/i18n/text";

export interface Requirement {
  title: TextKey;
  state: TextKey;
  isMet: boolean;
}

export interface VoiceFacts {
  hasKey: boolean;
  isKeyKept: boolean;
  /** Browsers grant a microphone only to secure pages: over HTTPS, or on the computer that runs the console. */
  isSecure: boolean;
  hasMicrophone: boolean;
  /** Whether this page contains the engine that talks to the voice service. */
  hasEngine: boolean;
}

export function requirements({ hasKey, isKeyKept, isSecure, hasMicrophone, hasEngine }: VoiceFacts): Requirement[] {
  return [
    { title: "voice_need_key", isMet: hasKey, state: !hasKey ? "voice_key_none" : isKeyKept ? "voice_key_kept" : "voice_key_page_only" },
    {
      title: "voice_need_microphone",
      isMet: isSecure && hasMicrophone,
      state: !isSecure ? "voice_not_secure" : hasMicrophone ? "voice_microphone_ready" : "voice_microphone_none",
    },
    { title: "voice_need_engine", isMet: hasEngine, state: hasEngine ? "voice_engine_ready" : "voice_engine_none" },
  ];
}
