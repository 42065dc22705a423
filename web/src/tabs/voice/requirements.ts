/** The requirements of voice, and which of them are met. */
import type { TextKey } from "@/i18n/text";
import type { Credential } from "./credentials";

export interface Requirement {
  title: TextKey;
  state: TextKey;
  isMet: boolean;
}

export interface VoiceFacts {
  by: Credential;
  /** Whether the key of this browser is stored beyond this page. */
  isKeyKept: boolean;
  /** Browsers grant a microphone only to secure pages: over HTTPS, or on the computer that runs the console. */
  isSecure: boolean;
  hasMicrophone: boolean;
}

export function requirements({ by, isKeyKept, isSecure, hasMicrophone }: VoiceFacts): Requirement[] {
  const keys: Record<Credential, TextKey> = {
    console: "voice_key_console",
    browser: isKeyKept ? "voice_key_kept" : "voice_key_page_only",
    offline: "voice_key_offline",
    script: "voice_key_none",
  };
  return [
    { title: "voice_need_key", isMet: by !== "script", state: keys[by] },
    {
      title: "voice_need_microphone",
      isMet: isSecure && hasMicrophone,
      state: !isSecure ? "voice_not_secure" : hasMicrophone ? "voice_microphone_ready" : "voice_microphone_none",
    },
  ];
}
