import { type ComponentProps, useEffect, useRef, useState } from "react";
import { cn } from "./cn";

export const HOLD_MS = 1200;

interface HoldButtonProps extends Omit<ComponentProps<"button">, "onClick"> {
  /** Called once the button was held for HOLD_MS. */
  onHeld: () => void;
  tone?: "light" | "dark";
}

/** A button for what must not happen by a slip: it acts after it was held, by pointer, Enter or Space. */
export function HoldButton({ onHeld, tone = "light", className, children, disabled, ...rest }: HoldButtonProps) {
  const [holding, setHolding] = useState(false);
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);

  function begin(): void {
    if (disabled === true || holding) return;
    setHolding(true);
    timer.current = setTimeout(() => {
      setHolding(false);
      onHeld();
    }, HOLD_MS);
  }

  function end(): void {
    clearTimeout(timer.current);
    setHolding(false);
  }

  useEffect(() => () => clearTimeout(timer.current), []);

  return (
    <button
      type="button"
      data-hold=""
      disabled={disabled}
      {...rest}
      onPointerDown={begin}
      onPointerUp={end}
      onPointerLeave={end}
      onPointerCancel={end}
      onBlur={end}
      onContextMenu={(event) => event.preventDefault()}
      onKeyDown={(event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        // Space stops the robot everywhere but on a button that is held by it.
        event.stopPropagation();
        event.preventDefault();
        if (!event.repeat) begin();
      }}
      onKeyUp={(event) => (event.key === "Enter" || event.key === " ") && end()}
      className={cn(
        "relative h-11 shrink-0 touch-none overflow-hidden rounded-md px-4 text-sm font-semibold select-none",
        tone === "light" ? "bg-text" : "border border-line-strong bg-raised text-text",
        "disabled:cursor-not-allowed disabled:bg-transparent disabled:text-text-3 disabled:outline disabled:outline-line",
        className,
      )}
    >
      <span
        aria-hidden="true"
        className={cn("absolute inset-0 origin-left", tone === "light" ? "bg-alive" : "bg-stop")}
        style={{
          transform: holding ? "scaleX(1)" : "scaleX(0)",
          transition: holding ? `transform ${HOLD_MS}ms linear` : "none",
        }}
      />
      <span className={cn("relative inline-flex items-center gap-2", tone === "light" && disabled !== true && "text-ground")}>{children}</span>
    </button>
  );
}
