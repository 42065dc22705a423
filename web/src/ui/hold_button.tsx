import { type ComponentProps, useEffect, useRef, useState } from "react";
import { useText } from "@/i18n/text";
import { cn } from "./cn";
import { onHoldsEnd } from "./holds";

export const HOLD_MS = 1200;

/**
 * How long the button waits for a late release once its timer has ended, before it acts.
 *
 * A page that was blocked handles late what happened meanwhile: its timer may run before the release of a hold that was too
 * short. The input that waits is handled within this time. Chromium and Firefox have it in the page's own queue, and prefer it
 * to timers; Safari hands over each event after the one before was handled, which takes a few milliseconds. A release during
 * this time, also one that is handled after another block, ends a hold that was long enough. (Only Chromium can be asked
 * whether input waits.)
 */
const SETTLE_MS = 50;

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
  /** When the click came that waits for its confirmation, in the time of events; null without one. */
  const [clickedMs, setClickedMs] = useState<number | null>(null);
  /** When the hold began, in the time of events; null without one. */
  const pressedMs = useRef<number | null>(null);
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  const confirmTimer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);

  function begin(event: { timeStamp: number }): void {
    if (disabled === true || pressedMs.current !== null) return;
    pressedMs.current = event.timeStamp;
    setHolding(true);
    timer.current = setTimeout(() => (timer.current = setTimeout(act, SETTLE_MS)), HOLD_MS);
  }

  /** The times of the events count: where the page was blocked, the timer of a hold that was long enough may not have ended. */
  function release(event: { timeStamp: number }): void {
    if (pressedMs.current !== null && event.timeStamp - pressedMs.current >= HOLD_MS) act();
    else cancel();
  }

  function act(): void {
    cancel();
    setTimesHeld((times) => times + 1);
    onHeld();
  }

  function cancel(): void {
    clearTimeout(timer.current);
    pressedMs.current = null;
    setHolding(false);
  }

  function forgetClick(): void {
    clearTimeout(confirmTimer.current);
    setClickedMs(null);
  }

  function click(event: { timeStamp: number }): void {
    if (disabled === true) return;
    if (clickedMs === null) {
      setClickedMs(event.timeStamp);
      confirmTimer.current = setTimeout(() => setClickedMs(null), CONFIRM_MS);
    } else if (event.timeStamp - clickedMs >= APART_MS) {
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
    pressedMs.current = null;
    clearTimeout(confirmTimer.current);
  }, [disabled]);
  useEffect(() => {
    const forget = onHoldsEnd(() => {
      cancel();
      forgetClick();
    });
    return () => {
      forget();
      clearTimeout(timer.current);
      clearTimeout(confirmTimer.current);
    };
  }, []);

  return (
    <button
      type="button"
      data-times-held={timesHeld}
      disabled={disabled}
      {...rest}
      onPointerDown={(event) => event.button === 0 && event.isPrimary && begin(event)}
      onClick={(event) => event.detail === 0 && click(event)}
      onPointerUp={release}
      // Whoever leaves the button gives up, however late the page shows the hold.
      onPointerLeave={cancel}
      onPointerCancel={cancel}
      onBlur={() => {
        cancel();
        forgetClick();
      }}
      onContextMenu={(event) => event.preventDefault()}
      onKeyDown={(event) => {
        if (event.key !== "Enter") return;
        event.preventDefault(); // no click follows
        if (!event.repeat) begin(event);
      }}
      onKeyUp={(event) => {
        if (event.key === "Enter") release(event);
      }}
      className={cn(
        "relative min-h-11 max-w-full shrink-0 touch-none overflow-hidden rounded-md px-4 text-sm font-semibold select-none",
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
      <span aria-live="polite" className={cn("relative inline-flex items-center gap-2 align-middle", tone === "light" && disabled !== true && "text-ground")}>
        {clickedMs === null ? children : text("hold_confirm")}
      </span>
    </button>
  );
}
