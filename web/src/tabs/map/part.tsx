import { type ReactNode, useState } from "react";
import { showProblem } from "@/state/problems";
import { Button } from "@/ui/button";

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
  /** Saves under a name; resolves once the server has it. */
  save: (name: string) => Promise<void>;
}

/** Saves something under a name. */
export function SaveForm({ label, placeholder, icon, disabled = false, save }: SaveFormProps) {
  const [name, setName] = useState("");
  const [isBusy, setBusy] = useState(false);
  return (
    <form
      className="flex gap-2"
      onSubmit={(event) => {
        event.preventDefault();
        setBusy(true);
        save(name.trim())
          .then(() => setName(""), showProblem)
          .finally(() => setBusy(false));
      }}
    >
      <input
        value={name}
        onChange={(event) => setName(event.target.value)}
        aria-label={placeholder}
        placeholder={placeholder}
        maxLength={64}
        className="h-10 min-w-0 grow rounded-md border border-line-strong bg-well px-3 placeholder:text-text-3 max-xl:h-11 pointer-coarse:h-11"
      />
      <Button type="submit" disabled={disabled || isBusy || name.trim() === ""}>
        {icon}
        {label}
      </Button>
    </form>
  );
}
