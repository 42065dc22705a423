import { Check, Copy } from "lucide-react";
import { useState } from "react";
import { useText } from "@/i18n/text";
import { Button } from "./button";

const SHOWN_MS = 1500;

/** A command for a terminal, to be read and copied. */
export function CommandLine({ command }: { command: string }) {
  const text = useText();
  const [copied, setCopied] = useState(false);

  function copy(): void {
    // Where the browser gives no clipboard to plain HTTP, the command can still be selected.
    navigator.clipboard
      ?.writeText(command)
      .then(() => {
        setCopied(true);
        setTimeout(() => setCopied(false), SHOWN_MS);
      })
      .catch(() => {});
  }

  return (
    <div className="flex max-w-full items-center gap-2">
      <code className="min-w-0 truncate rounded-sm border border-line bg-well px-2.5 py-1.5 text-xs select-all numeric" title={command}>
        {command}
      </code>
      <Button kind="quiet" size="small" onClick={copy} className="px-2">
        {copied ? <Check className="text-alive" /> : <Copy />}
        {text(copied ? "doctor_copied" : "doctor_copy")}
      </Button>
    </div>
  );
}
