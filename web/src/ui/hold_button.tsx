import { type ComponentProps, useEffect, useRef, useState } from "react";
import { useText } from "@/i18n/text";
import { cn } from "./cn";

export const HOLD_MS = 1200;

interface HoldButtonProps extends Omit<ComponentProps<"button">, "onClick"> {
  /** Called once the button was held for HOLD_MS. */
  onHeld: () => void;
  tone?: "light" | "dark";
}

/** How long a click that cannot hold waits for the second one, which confirms it, and how far apart the two must be. */
const CONFIRM_MS = 8000;
const APART_MS = 400;

/**
 * A button for what must not happen by a slip: it acts after it was held, by pointer or Enter; Space stops the robot here, as
 * everywhere. What presses buttons for a person, such as a screen reader, cannot hold: it clicks, and clicks again to confirm.
 */
export function HoldButton({ onHeld, tone = "light", className, children, disabled, ...rest }: HoldButtonProps) {
  const text = useText();
  const [holding, setHolding] = useState(false);
  /** How often it was held long enough, so that a test can wait for that instead of a time. */
  const [timesHeld, setTimesHeld] = useState(0);
  /** performance.now() of the click that waits for its confirmation; null without one. */
  const [clickedMs, setClickedMs] = useState<number | null>(null);
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  const confirmTimer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);

  function begin(): void {
    if (disabled === true || holding) return;
    setHolding(true);
    timer.current = setTimeout(() => {
      setHolding(false);
      setTimesHeld((times) => times + 1);
      onHeld();
    }, HOLD_MS);
  }

  function end(): void {
    clearTimeout(timer.current);
    setHolding(false);
  }

  function forgetClick(): void {
    clearTimeout(confirmTimer.current);
    setClickedMs(null);
  }

  function click(): void {
    if (disabled === true) return;
    const now = performance.now();
    if (clickedMs === null) {
      setClickedMs(now);
      confirmTimer.current = setTimeout(() => setClickedMs(null), CONFIRM_MS);
    } else if (now - clickedMs >= APART_MS) {
      forgetClick();
      onHeld();
    }
  }

  if (disabled === true && (holding || clickedMs !== null)) {
    setHolding(false);
    setClickedMs(null);
  }
  useEffect(() => {
    if (disabled !== true) return;
    clearTimeout(timer.current);
    clearTimeout(confirmTimer.current);
  }, [disabled]);
  useEffect(
    () => () => {
      clearTimeout(timer.current);
      clearTimeout(confirmTimer.current);
    },
    [],
  );

  return (
    <button
      type="button"
      data-times-held={timesHeld}
      disabled={disabled}
      {...rest}
      onPointerDown={(event) => event.button === 0 && event.isPrimary && begin()}
      onClick={(event) => event.detail === 0 && click()}
      onPointerUp={end}
      onPointerLeave={end}
      onPointerCancel={end}
      onBlur={() => {
        end();
        forgetClick();
      }}
      onContextMenu={(event) => event.preventDefault()}
      onKeyDown={(event) => {
        if (event.key !== "Enter") return;
        event.preventDefault(); // no click follows
        if (!event.repeat) begin();
      }}
      onKeyUp={(event) => {
        if (event.key === "Enter") end();
      }}
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
      <span aria-live="polite" className={cn("relative inline-flex items-center gap-2", tone === "light" && disabled !== true && "text-ground")}>
        {clickedMs === null ? children : text("hold_confirm")}
      </span>
    </button>
  );
}
