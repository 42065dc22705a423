import { TriangleAlert } from "lucide-react";
import { IS_MOCK } from "@/environment";
import { useText } from "@/i18n/text";
import { useVoice } from "./voice_store";

/** Says that no model answers. */
export function ScriptBanner() {
  const text = useText();
  const isShown = useVoice(({ session, isScripted }) => session !== "off" && isScripted);
  if (!isShown && !IS_MOCK) return null;
  return (
    <p role="status" data-testid="voice-script" className="flex items-start gap-3 rounded-lg border border-attention bg-attention-wash p-3">
      <TriangleAlert aria-hidden="true" className="mt-0.5 size-5 shrink-0 text-attention" />
      <span>
        <strong className="font-semibold text-attention">{text(IS_MOCK ? "voice_script_mock" : "voice_script_title")}</strong>
        <span className="block text-sm text-text-2">{text(IS_MOCK ? "voice_script_mock_explained" : "voice_script_explained")}</span>
      </span>
    </p>
  );
}
