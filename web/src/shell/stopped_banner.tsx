import { Octagon } from "lucide-react";
import { useState } from "react";
import { hasControl, useConsole } from "@/api/console_store";
import { useEstop } from "@/hooks/use_situation";
import { useText } from "@/i18n/text";
import { release, useGate, useLink } from "@/robot";
import { cn } from "@/ui/cn";
import { HoldButton } from "@/ui/hold_button";

/** Why the robot is stopped, who holds it, and the release: at the far end from the stop. */
export function StoppedBanner() {
  const text = useText();
  const gate = useGate();
  const estop = useEstop();
  const state = useConsole();
  const linkOpen = useLink((link) => link.state === "open");
  const [problem, setProblem] = useState("");
  const stopped = estop.engaged === true || state.stop.length > 0;
  if (!linkOpen || state.own === null || (!stopped && !gate.engaged)) return null;

  const own = gate.engaged && gate.reason !== null ? text(`reason_${gate.reason}`) : "";
  const reasons = [...new Set([...estop.reasons, ...state.stop])];
  const holder = state.control.holder;
  const mayRelease = state.own.role === "operator" && (holder === null || hasControl(state));

  async function tryRelease(): Promise<void> {
    try {
      await release();
      setProblem("");
    } catch (error) {
      setProblem(error instanceof Error ? error.message : String(error));
    }
  }

  return (
    <div
      role="status"
      className={cn(
        "flex min-h-14 shrink-0 flex-wrap items-center gap-x-4 gap-y-2 border-b px-4 py-2",
        stopped ? "border-stop bg-stop-wash" : "border-line bg-panel",
      )}
    >
      <HoldButton onHeld={() => void tryRelease()} disabled={!mayRelease} data-testid="release">
        {stopped ? text("hold_to_release") : text("hold_to_start")}
      </HoldButton>
      <Octagon aria-hidden="true" className={cn("size-6 shrink-0", stopped ? "text-stop-text" : "text-text-3")} />
      <p className="min-w-0 grow basis-60">
        <strong className={cn("font-semibold", stopped ? "text-stop-text" : "text-text")}>
          {stopped ? text("stopped_by", { reason: reasons.join(", ") || own }) : text("can_drive_no", { reason: own })}
        </strong>
        <span className="block text-xs text-text-2">
          {problem !== ""
            ? text("release_failed", { reason: problem })
            : mayRelease
              ? text("nothing_moves_after_release")
              : text("release_needs_control", { holder: holder ?? "" })}
        </span>
      </p>
    </div>
  );
}
