/** What voice needs, and what of it is there. */
import type { TextKey } from "@/i18n/text";

export interface Requirement {
  title: TextKey;
  state: TextKey;
  isMet: boolean;
}

export interface VoiceFacts {
  hasKey: boolean;
  isKeyKept: boolean;
  /** Browsers give a microphone to secure pages only: HTTPS, or the robot's own computer. */
  isSecure: boolean;
  hasMicrophone: boolean;
  /** Whether this page carries the engine that speaks with the service. */
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
