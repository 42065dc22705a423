import { OctagonX } from "lucide-react";
import { useEffect } from "react";
import { useConsole } from "@/api/console_store";
import { useAge } from "@/hooks/use_now";
import { useEstop } from "@/hooks/use_situation";
import { useText } from "@/i18n/text";
import { stop, useLink } from "@/robot";
import { cn } from "@/ui/cn";
import { span } from "@/ui/numbers";

const HEARD_TOO_LONG_AGO_S = 1.5;

/** The permanent stop: full height at the right, or full width above the tabs of a phone. Space does the same. */
export function StopBar() {
  const text = useText();
  const estop = useEstop();
  const serverStops = useConsole((state) => state.stop.length > 0);
  const linkOpen = useLink((link) => link.state === "open");
  const age = useAge(estop.receivedMs);
  const heard = linkOpen && age !== null && age < HEARD_TOO_LONG_AGO_S;
  const stopped = estop.engaged === true || serverStops;

  useEffect(() => {
    // Captured before everything else: nothing on the page may keep the space bar from stopping the robot.
    const onKey = (event: KeyboardEvent) => {
      if (event.code !== "Space" || event.repeat || isTyping(event.target) || isHeldButton(event.target)) return;
      event.preventDefault();
      stop();
    };
    window.addEventListener("keydown", onKey, { capture: true });
    return () => window.removeEventListener("keydown", onKey, { capture: true });
  }, []);

  return (
    <button
      type="button"
      data-testid="stop"
      aria-pressed={stopped}
      onPointerDown={(event) => event.button === 0 && stop()}
      onKeyDown={(event) => event.key === "Enter" && stop()}
      className={cn(
        "relative z-60 flex shrink-0 touch-manipulation flex-col items-center justify-between bg-stop py-4 text-white select-none active:bg-stop-deep",
        "focus-visible:outline-4 focus-visible:-outline-offset-6 focus-visible:outline-white",
        "max-md:h-(--stop) max-md:w-full max-md:flex-row max-md:justify-center max-md:gap-4 max-md:px-4 max-md:py-0 md:w-(--stop)",
        stopped && "bg-stop-deep",
      )}
    >
      <span className="text-center text-xs font-semibold max-md:hidden">{text("stop_hint")}</span>
      <span className="flex flex-col items-center gap-3 max-md:flex-row">
        <OctagonX aria-hidden="true" className="size-14 max-md:size-9" strokeWidth={1.8} />
        <span className={cn("text-xl font-extrabold uppercase", stopped ? "md:text-lg" : "tracking-wide")}>{stopped ? text("is_stopped") : text("stop")}</span>
      </span>
      <span className="px-2 text-center text-xs font-semibold max-md:sr-only">
        {heard ? text("stop_heard", { age: span(age) }) : text("stop_not_heard")}
      </span>
    </button>
  );
}

function isTyping(target: EventTarget | null): boolean {
  if (!(target instanceof HTMLElement)) return false;
  if (target.isContentEditable || target instanceof HTMLTextAreaElement) return true;
  return target instanceof HTMLInputElement && !["checkbox", "radio", "range", "button"].includes(target.type);
}

/** A button that is being held by the space bar, such as the release: it acts only after a second, and deliberately. */
function isHeldButton(target: EventTarget | null): boolean {
  return target instanceof HTMLElement && target.closest("[data-hold]") !== null;
}
