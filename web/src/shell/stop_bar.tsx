import { OctagonX } from "lucide-react";
import { type MouseEvent, type PointerEvent, useEffect, useRef } from "react";
import { useConsole } from "@/api/console_store";
import { useAge } from "@/hooks/use_now";
import { useEstop } from "@/hooks/use_situation";
import { type TextKey, useText } from "@/i18n/text";
import { useLink } from "@/robot/link";
import { stop, useGate } from "@/robot/stop";
import { type StopDelivery, stopDelivery } from "@/state/stop_delivery";
import { cn } from "@/ui/cn";
import { isTypingSpace } from "@/ui/keyboard";
import { formatDuration } from "@/ui/numbers";

const HEARD_TOO_LONG_AGO_S = 1.5;

const LABELS: Record<StopDelivery, TextKey> = { ready: "stop", sent: "stop_sent", stopped: "is_stopped", unsent: "stop_unsent", unconfirmed: "stop_unconfirmed" };

/** How long after the end of a press its click may come. */
const CLICK_AFTER_MS = 500;

/**
 * What a stop button reacts to. A press stops at once, and not at its end; its own click is the same press. Every other click
 * stops as well: screen readers, switches and voice control send clicks only, and so does the Enter key.
 *
 * A press may end without a click: the pointer left the button, or what it pointed at was replaced. So the wait for the click
 * ends with the press, or else the next click of a screen reader would stop nothing. A finger leaves before its click.
 */
function usePress() {
  /** Until when a click belongs to a press that has stopped already, in the time of events. */
  const ownClickUntilMs = useRef(-Infinity);
  const endPress = (event: PointerEvent) => {
    ownClickUntilMs.current = Math.min(ownClickUntilMs.current, event.timeStamp + CLICK_AFTER_MS);
  };
  return {
    onPointerDown: (event: PointerEvent) => {
      if (event.button !== 0) return;
      stop();
      ownClickUntilMs.current = Infinity;
    },
    onPointerUp: endPress,
    onPointerLeave: endPress,
    onClick: (event: MouseEvent) => {
      const isOwn = event.timeStamp <= ownClickUntilMs.current;
      ownClickUntilMs.current = -Infinity;
      if (!isOwn) stop();
    },
  };
}

/** The permanent stop: full height at the right, or full width above the tabs of a phone. Space does the same, whatever has the focus. */
export function StopBar() {
  const text = useText();
  const delivery = useStopDelivery();
  const isDoubtful = delivery === "unsent" || delivery === "unconfirmed";
  const press = usePress();
  useStopKey();
  return (
    <button
      type="button"
      data-testid="stop"
      data-stop=""
      data-delivery={delivery}
      aria-pressed={delivery !== "ready"}
      {...press}
      className={cn(
        "relative z-60 flex shrink-0 touch-manipulation flex-col items-center justify-between py-4 text-white select-none active:bg-stop-deep",
        "focus-visible:outline-4 focus-visible:-outline-offset-6 focus-visible:outline-white",
        "max-md:h-(--stop) max-md:w-full max-md:flex-row max-md:justify-center max-md:gap-4 max-md:px-4 max-md:py-0 md:w-(--stop)",
        // Loudest while the robot is stopped: it must be read from three metres.
        delivery === "ready" ? "bg-stop-rest" : "bg-stop shadow-[inset_0_0_0_6px_white]",
      )}
    >
      <span className="px-2 text-center text-xs font-semibold max-md:hidden">{text("stop_hint")}</span>
      <span className="flex min-h-0 flex-col items-center gap-3 max-md:flex-row">
        <OctagonX aria-hidden="true" className="size-14 shrink-0 max-md:size-9" strokeWidth={1.8} />
        <span
          className={cn(
            "text-center font-extrabold uppercase",
            delivery === "ready" && "text-xl tracking-wide",
            delivery === "stopped" && "text-[clamp(28px,10.5vw,40px)] leading-none md:rotate-180 md:text-[clamp(44px,9vh,calc(var(--stop)*0.75))] md:[writing-mode:vertical-rl]",
            delivery !== "ready" && delivery !== "stopped" && "text-xl leading-tight md:px-1.5 md:text-lg",
          )}
        >
          {text(LABELS[delivery])}
        </span>
      </span>
      <span className="px-2 text-center text-xs font-semibold text-balance max-md:max-w-28 max-md:px-0">{isDoubtful ? text("stop_use_button") : <Heard />}</span>
      <span role="status" className="sr-only">
        {delivery !== "ready" && `${text(LABELS[delivery])}${isDoubtful ? `: ${text("stop_use_button")}` : ""}`}
      </span>
    </button>
  );
}

/** When the robot said last whether it is stopped. */
function Heard() {
  const text = useText();
  const linkOpen = useLink((link) => link.state === "open");
  const age = useAge(useEstop().receivedMs);
  const isHeard = linkOpen && age !== null && age < HEARD_TOO_LONG_AGO_S;
  return <span aria-hidden="true">{isHeard ? text("stop_heard", { age: formatDuration(age) }) : text("stop_not_heard")}</span>;
}

function useStopDelivery(): StopDelivery {
  const { isStated, wasSent, statedMs } = useGate();
  const robotStopped = useEstop().engaged;
  const serverStops = useConsole((state) => state.online && state.stop.length > 0);
  const linkOpen = useLink((link) => link.state === "open");
  const age = useAge(statedMs);
  return stopDelivery({ linkOpen, robotStopped, serverStops, isStated, wasSent, ageMs: age === null ? null : age * 1000 });
}

/** The same stop beside the sticks, for a hand that is there. */
export function MirroredStop({ className }: { className?: string }) {
  const text = useText();
  const delivery = useStopDelivery();
  const press = usePress();
  return (
    <button
      type="button"
      data-testid="stop-mirrored"
      aria-pressed={delivery !== "ready"}
      {...press}
      className={cn(
        "flex min-h-14 shrink-0 touch-manipulation items-center justify-center gap-3 rounded-lg bg-stop px-4 text-lg font-extrabold text-white uppercase select-none active:bg-stop-deep",
        "focus-visible:outline-4 focus-visible:-outline-offset-6 focus-visible:outline-white",
        delivery !== "ready" && "bg-stop-deep",
        className,
      )}
    >
      <OctagonX aria-hidden="true" className="size-7" />
      {text(LABELS[delivery])}
    </button>
  );
}

/** What stands in the place of a stop bar that failed: it stops, whatever else it cannot show. */
export function PlainStop() {
  const text = useText();
  const press = usePress();
  useStopKey();
  return (
    <button
      type="button"
      data-testid="stop"
      data-stop=""
      {...press}
      className="relative z-60 shrink-0 bg-stop text-xl font-extrabold text-white uppercase max-md:h-(--stop) max-md:w-full md:w-(--stop)"
    >
      {text("stop")}
    </button>
  );
}

function useStopKey(): void {
  useEffect(() => {
    const isStopKey = (event: KeyboardEvent) => (event.code === "Space" || event.key === " ") && !isTypingSpace(event.target);
    // A key that is held down repeats; each repetition would press the button that has the focus.
    const onDown = (event: KeyboardEvent) => {
      if (!isStopKey(event)) return;
      event.preventDefault();
      if (!event.repeat) stop();
    };
    // Firefox clicks the button that has the focus when the key comes up, even if nothing followed its going down.
    const onUp = (event: KeyboardEvent) => isStopKey(event) && event.preventDefault();
    // Captured before everything else: nothing on the page may keep the space bar from stopping the robot.
    window.addEventListener("keydown", onDown, { capture: true });
    window.addEventListener("keyup", onUp, { capture: true });
    return () => {
      window.removeEventListener("keydown", onDown, { capture: true });
      window.removeEventListener("keyup", onUp, { capture: true });
    };
  }, []);
}
