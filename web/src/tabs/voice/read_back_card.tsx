import { Check, X } from "lucide-react";
import { useNow } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { RobotWords } from "@/ui/robot_words";
import { confirmReadBack, refuseReadBack } from "./voice_session";
import { useVoice } from "./voice_store";

/** What the agent asks the operator to confirm, in the console's words. */
export function ReadBackCard() {
  const text = useText();
  const readBack = useVoice((view) => view.readBack);
  const now = useNow();
  const seconds = readBack === null ? 0 : Math.ceil((readBack.expiresMs - now) / 1000);
  if (readBack === null || seconds <= 0) return null;
  return (
    <section aria-labelledby="voice-confirm" data-testid="voice-confirm" className="flex flex-col gap-3 rounded-lg border border-attention bg-attention-wash p-4">
      <span role="alert" className="sr-only">
        {text("voice_confirm_title")} <RobotWords words={readBack.sentence} />
      </span>
      <h2 id="voice-confirm" className="text-sm font-semibold text-attention">
        {text("voice_confirm_title")}
      </h2>
      <p className="text-lead leading-snug font-bold break-words">
        <RobotWords words={readBack.sentence} />
      </p>
      <div className="flex flex-wrap items-center gap-3">
        <Button kind="primary" className="h-14 min-w-40 text-base max-md:grow" onClick={confirmReadBack}>
          <Check />
          {text("voice_confirm")}
        </Button>
        <Button className="h-14 min-w-40 text-base max-md:grow" onClick={refuseReadBack}>
          <X />
          {text("voice_confirm_cancel")}
        </Button>
        <p className="text-sm text-text-2 max-md:basis-full">{text("voice_confirm_hint", { seconds })}</p>
      </div>
    </section>
  );
}
