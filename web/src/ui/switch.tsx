import { Switch as Radix } from "radix-ui";
import { useId } from "react";

interface SwitchProps {
  label: string;
  hint?: string;
  checked: boolean;
  disabled?: boolean;
  onChange: (checked: boolean) => void;
}

export function Switch({ label, hint, checked, disabled = false, onChange }: SwitchProps) {
  const id = useId();
  return (
    <div className="flex min-h-11 items-center gap-4">
      <label htmlFor={id} className="grow">
        {label}
        {hint !== undefined && <span className="block text-xs text-text-3">{hint}</span>}
      </label>
      <Radix.Root
        id={id}
        checked={checked}
        disabled={disabled}
        onCheckedChange={onChange}
        className="group grid h-11 w-12 shrink-0 place-items-center disabled:opacity-60"
      >
        <span className="flex h-7 w-12 items-center rounded-full border border-line-strong bg-well transition-colors group-data-[state=checked]:border-alive-2 group-data-[state=checked]:bg-alive-2">
          <Radix.Thumb className="block size-5 translate-x-[3px] rounded-full bg-text transition-transform data-[state=checked]:translate-x-[23px]" />
        </span>
      </Radix.Root>
    </div>
  );
}
