import { type ReactNode, useState } from "react";
import { useText } from "@/i18n/text";
import { showProblem } from "@/state/problems";
import { Button } from "@/ui/button";
import { HoldButton } from "@/ui/hold_button";

/** A part of the places, with its title. */
export function Part({ title, children }: { title: string; children: ReactNode }) {
  return (
    <section className="flex flex-col gap-2">
      <h3 className="text-sm font-semibold text-text-2">{title}</h3>
      {children}
    </section>
  );
}

interface SaveFormProps {
  label: string;
  placeholder: string;
  icon: ReactNode;
  disabled?: boolean;
  /** The names under which there is something, which is replaced only by a hold. */
  taken: readonly string[];
  /** Saves under a name; resolves once the server has it. */
  save: (name: string, replace: boolean) => Promise<void>;
}

/** Saves something under a name. */
export function SaveForm({ label, placeholder, icon, disabled = false, taken, save }: SaveFormProps) {
  const text = useText();
  const [name, setName] = useState("");
  const [isBusy, setBusy] = useState(false);
  const isTaken = taken.includes(name.trim());
  const isOff = disabled || isBusy || name.trim() === "";
  const saveNow = (replace: boolean) => {
    setBusy(true);
    save(name.trim(), replace)
      .then(() => setName(""), showProblem)
      .finally(() => setBusy(false));
  };
  return (
    <form
      className="flex flex-wrap gap-2"
      onSubmit={(event) => {
        event.preventDefault();
        if (!isTaken) saveNow(false);
      }}
    >
      <input
        value={name}
        onChange={(event) => setName(event.target.value)}
        aria-label={placeholder}
        placeholder={placeholder}
        maxLength={64}
        className="h-10 min-w-0 grow basis-32 rounded-md border border-line-strong bg-well px-3 placeholder:text-text-3 max-xl:h-11 pointer-coarse:h-11"
      />
      {isTaken ? (
        <HoldButton tone="dark" type="button" disabled={isOff} onHeld={() => saveNow(true)}>
          {text("map_replace")}
        </HoldButton>
      ) : (
        <Button type="submit" disabled={isOff}>
          {icon}
          {label}
        </Button>
      )}
    </form>
  );
}
