import { Mic } from "lucide-react";
import { useEffect } from "react";
import { useText } from "@/i18n/text";
import { cn } from "@/ui/cn";
import { beginTalk, endTalk } from "./voice_session";
import { useVoice } from "./voice_store";

/** The button by which the operator speaks: held, or pressed once to begin and once to end. */
export function TalkButton({ mode }: { mode: "hold" | "toggle" }) {
  const text = useText();
  const isSpeaking = useVoice((view) => view.isOperatorSpeaking);
  const isLinked = useVoice((view) => view.isConsoleOpen);
  useEffect(() => {
    if (mode !== "hold") return undefined;
    // Wherever the pointer is by then, the hold ends.
    window.addEventListener("blur", endTalk);
    return () => window.removeEventListener("blur", endTalk);
  }, [mode]);

  const hold = {
    onPointerDown: (event: React.PointerEvent<HTMLButtonElement>) => {
      if (event.button !== 0 || !event.isPrimary) return;
      event.currentTarget.setPointerCapture(event.pointerId);
      beginTalk();
    },
    onPointerUp: endTalk,
    onPointerCancel: endTalk,
    onBlur: endTalk,
    onContextMenu: (event: React.MouseEvent) => event.preventDefault(),
    onKeyDown: (event: React.KeyboardEvent) => {
      if (event.key !== "Enter") return;
      event.preventDefault();
      if (!event.repeat) beginTalk();
    },
    onKeyUp: (event: React.KeyboardEvent) => {
      if (event.key === "Enter") endTalk();
    },
    // What presses buttons for a person cannot hold: it presses twice.
    onClick: (event: React.MouseEvent) => event.detail === 0 && toggle(),
  };
  const toggle = () => (useVoice.getState().isOperatorSpeaking ? endTalk() : beginTalk());
  const handlers = mode === "hold" ? hold : { onClick: toggle };

  return (
    <button
      type="button"
      data-testid="talk"
      disabled={!isLinked}
      aria-pressed={isSpeaking}
      {...handlers}
      className={cn(
        "flex h-20 min-w-60 grow touch-none px-5 items-center justify-center gap-3 rounded-lg border text-lg font-bold select-none max-md:basis-full",
        "disabled:cursor-not-allowed disabled:border-line disabled:bg-transparent disabled:text-text-3",
        isSpeaking ? "border-sensed bg-sensed-wash text-sensed" : "border-alive bg-alive text-alive-ink",
      )}
    >
      <Mic aria-hidden="true" className="size-7 shrink-0" />
      {text(mode === "hold" ? (isSpeaking ? "voice_release_to_send" : "voice_hold_to_talk") : isSpeaking ? "voice_press_to_send" : "voice_press_to_talk")}
    </button>
  );
}
