import { SendHorizontal } from "lucide-react";
import { type FormEvent, useState } from "react";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { say } from "./voice_session";
import { useVoice } from "./voice_store";

const MAX_LENGTH = 2000;

/** A text for the agent. */
export function SayForm() {
  const text = useText();
  const [typed, setTyped] = useState("");
  const canSend = useVoice((view) => view.session !== "off" && view.isConsoleOpen);

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (typed.trim() === "" || !canSend) return;
    say(typed.trim());
    setTyped("");
  }

  return (
    <form onSubmit={submit} className="panel flex shrink-0 gap-2 p-2">
      <input
        type="text"
        value={typed}
        onChange={(event) => setTyped(event.target.value)}
        aria-label={text("voice_type")}
        placeholder={text("voice_type")}
        autoComplete="off"
        maxLength={MAX_LENGTH}
        className="min-h-11 min-w-0 grow rounded-md border border-line-strong bg-well px-3 text-base placeholder:text-text-3"
      />
      <Button type="submit" className="h-11" disabled={!canSend || typed.trim() === ""}>
        <SendHorizontal />
        {text("voice_send")}
      </Button>
    </form>
  );
}
