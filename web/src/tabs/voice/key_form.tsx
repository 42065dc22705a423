import { KeyRound } from "lucide-react";
import { type FormEvent, useId, useState } from "react";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { changeKey, useVoiceKey } from "./voice_key";

/** A form to enter or delete the key. A stored key is never shown. */
export function KeyForm() {
  const text = useText();
  const id = useId();
  const hasKey = useVoiceKey(({ key }) => key !== "");
  const [typed, setTyped] = useState("");

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (typed.trim() === "") return;
    changeKey(typed);
    setTyped("");
  }

  return (
    <form onSubmit={submit} className="flex flex-col gap-1.5">
      <label htmlFor={id} className="text-sm">
        {text("voice_key")}
        <span className="block text-xs text-text-3">{text("voice_key_hint")}</span>
      </label>
      <div className="flex gap-2">
        <input
          id={id}
          type="password"
          value={typed}
          onChange={(event) => setTyped(event.target.value)}
          placeholder={hasKey ? text("voice_key_stored") : ""}
          autoComplete="off"
          spellCheck={false}
          maxLength={400}
          className="min-h-10 min-w-0 grow rounded-md border border-line-strong bg-well px-3 text-sm placeholder:text-text-3 max-xl:min-h-11"
        />
        <Button type="submit" disabled={typed.trim() === ""}>
          <KeyRound />
          {text("voice_key_save")}
        </Button>
        {hasKey && (
          <Button kind="quiet" onClick={() => changeKey("")}>
            {text("voice_key_forget")}
          </Button>
        )}
      </div>
    </form>
  );
}
