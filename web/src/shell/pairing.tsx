import { type FormEvent, useState } from "react";
import { pair } from "@/api/pairing";
import { errorText } from "@/i18n/error_text";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";

/** Where a browser that is not paired types the code of the terminal. */
export function Pairing() {
  const text = useText();
  const [code, setCode] = useState("");
  const [problem, setProblem] = useState("");

  function submit(event: FormEvent): void {
    event.preventDefault();
    pair(code.trim()).catch((error: unknown) => setProblem(errorText(error)));
  }

  return (
    <main className="grid h-full place-items-center p-6">
      <form onSubmit={submit} className="panel flex w-full max-w-md flex-col gap-4 p-6">
        <h1 className="text-lead font-bold">{text("pairing_title")}</h1>
        <label className="flex flex-col gap-2 text-text-2">
          {text("pairing_explained")}
          <input
            value={code}
            onChange={(event) => setCode(event.target.value)}
            name="code"
            required
            maxLength={20}
            autoComplete="one-time-code"
            autoCapitalize="characters"
            spellCheck={false}
            className="h-14 rounded-md border border-line-strong bg-well px-4 text-xl tracking-[0.2em] text-text numeric"
          />
        </label>
        <Button kind="primary" type="submit" className="h-12 text-base">
          {text("pair")}
        </Button>
        {problem !== "" && (
          <p role="alert" className="text-attention">
            {problem}
          </p>
        )}
      </form>
    </main>
  );
}
