import { Slider as Radix } from "radix-ui";
import { cn } from "./cn";

interface SliderProps {
  label: string;
  value: number;
  min: number;
  max: number;
  step?: number;
  disabled?: boolean;
  onChange: (value: number) => void;
  onCommit?: (value: number) => void;
  valueText?: string;
  className?: string;
}

export function Slider({ label, value, min, max, step = 1, disabled = false, onChange, onCommit, valueText, className }: SliderProps) {
  return (
    <Radix.Root
      value={[value]}
      min={min}
      max={max}
      step={step}
      disabled={disabled}
      onValueChange={([next]) => next !== undefined && onChange(next)}
      onValueCommit={([next]) => next !== undefined && onCommit?.(next)}
      className={cn("relative flex h-11 w-full touch-none items-center select-none", className)}
    >
      <Radix.Track className="relative h-1.5 grow rounded-full bg-raised">
        <Radix.Range className="absolute h-full rounded-full bg-alive-2 data-[disabled]:bg-line-strong" />
      </Radix.Track>
      <Radix.Thumb
        aria-label={label}
        {...(valueText === undefined ? {} : { "aria-valuetext": valueText })}
        className="block size-6 rounded-full bg-text shadow-md data-[disabled]:bg-text-3"
      />
    </Radix.Root>
  );
}
