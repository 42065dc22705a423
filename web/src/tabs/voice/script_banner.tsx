import { TriangleAlert } from "lucide-react";
import { IS_MOCK } from "@/environment";
import { useText } from "@/i18n/text";

/** Says that nothing of the mock mode is real. */
export function ScriptBanner() {
  const text = useText();
  if (!IS_MOCK) return null;
  return (
    <p role="status" data-testid="voice-script" className="flex items-start gap-3 rounded-lg border border-attention bg-attention-wash p-3">
      <TriangleAlert aria-hidden="true" className="mt-0.5 size-5 shrink-0 text-attention" />
      <span>
        <strong className="font-semibold text-attention">{text("voice_script_mock")}</strong>
        <span className="block text-sm text-text-2">{text("voice_script_mock_explained")}</span>
      </span>
    </p>
  );
}
