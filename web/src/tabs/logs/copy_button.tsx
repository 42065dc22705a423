import { Check, Copy } from "lucide-react";
import { useEffect, useState } from "react";
import { useText } from "@/i18n/text";
import { showProblem } from "@/state/problems";
import { Button } from "@/ui/button";

const SHOWN_MS = 1500;

/** Copies a text, and says that it did. */
export function CopyButton({ textToCopy, label }: { textToCopy: string; label?: string }) {
  const text = useText();
  const [isCopied, setCopied] = useState(false);

  useEffect(() => {
    if (!isCopied) return;
    const timer = setTimeout(() => setCopied(false), SHOWN_MS);
    return () => clearTimeout(timer);
  }, [isCopied]);

  async function copy(): Promise<void> {
    try {
      // Pages without HTTPS have no clipboard.
      if (navigator.clipboard === undefined) throw new Error(text("logs_no_clipboard"));
      await navigator.clipboard.writeText(textToCopy);
      setCopied(true);
    } catch (error) {
      showProblem(error);
    }
  }

  return (
    <Button size="small" onClick={() => void copy()}>
      {isCopied ? <Check /> : <Copy />}
      {isCopied ? text("logs_copied") : (label ?? text("logs_copy"))}
    </Button>
  );
}
