import { type FormEvent, type ReactNode, useId, useState } from "react";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { Dialog } from "@/ui/dialog";
import { MAX_NAME_LENGTH, storedName } from "./library";

interface NameDialogProps {
  title: string;
  description?: string;
  submitLabel: string;
  initial?: string;
  /** Names that are in use. Saving under one of them needs a confirmation; without `mayOverwrite` it is refused. */
  taken: readonly string[];
  mayOverwrite: boolean;
  /** More fields below the name. */
  children?: ReactNode;
  onClose: () => void;
  /** Resolves to whether saving worked; otherwise the dialog stays open. */
  onSubmit: (name: string, overwrite: boolean) => Promise<boolean>;
}

/** Asks for the name of a pose or sequence, and for confirmation before one is replaced. */
export function NameDialog({ title, description, submitLabel, initial = "", taken, mayOverwrite, children, onClose, onSubmit }: NameDialogProps) {
  const text = useText();
  const field = useId();
  const [name, setName] = useState(initial);
  const [isBusy, setBusy] = useState(false);
  const stored = storedName(name);
  const isTaken = stored !== null && stored !== initial && taken.includes(stored);
  const isRefused = stored === null || (isTaken && !mayOverwrite);
  const hint = name !== "" && stored === null ? text("arm_name_rule", { length: MAX_NAME_LENGTH }) : isTaken ? text("arm_name_taken", { name: stored }) : "";

  async function submit(event: FormEvent): Promise<void> {
    event.preventDefault();
    if (stored === null || isRefused) return;
    setBusy(true);
    const worked = await onSubmit(stored, isTaken);
    setBusy(false);
    if (worked) onClose();
  }

  return (
    <Dialog open onOpenChange={(open) => !open && onClose()} title={title} {...(description === undefined ? {} : { description })}>
      <form onSubmit={(event) => void submit(event)} className="flex flex-col gap-4">
        <label htmlFor={field} className="flex flex-col gap-1.5 text-sm text-text-2">
          {text("arm_name")}
          <input
            id={field}
            value={name}
            onChange={(event) => setName(event.target.value)}
            maxLength={MAX_NAME_LENGTH + 8}
            autoComplete="off"
            autoCapitalize="none"
            spellCheck={false}
            aria-describedby={`${field}-hint`}
            className="h-12 rounded-md border border-line-strong bg-well px-3 text-base text-text"
          />
          <span id={`${field}-hint`} role="status" className="min-h-5 text-xs text-attention">
            {hint}
          </span>
        </label>
        {children}
        <div className="flex justify-end gap-3">
          <Button onClick={onClose}>{text("cancel")}</Button>
          <Button type="submit" kind="primary" disabled={isRefused || isBusy}>
            {isTaken && mayOverwrite ? text("arm_overwrite") : submitLabel}
          </Button>
        </div>
      </form>
    </Dialog>
  );
}
