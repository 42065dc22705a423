import { LockKeyhole, Power, PowerOff } from "lucide-react";
import { useStore } from "zustand";
import { type TextKey, useText } from "@/i18n/text";
import type { Reason } from "@/state/can_drive";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { HoldButton } from "@/ui/hold_button";
import { useArmModel } from "./arm_model";
import { type Torque, torqueObstacles } from "./torque";

const STATES: Record<"on" | "off" | "unknown", { title: TextKey; hint: TextKey; icon: typeof Power }> = {
  on: { title: "arm_torque_on", hint: "arm_torque_on_hint", icon: Power },
  off: { title: "arm_torque_off", hint: "arm_torque_off_hint", icon: PowerOff },
  unknown: { title: "arm_torque_unknown", hint: "arm_torque_unknown_hint", icon: LockKeyhole },
};

function stateOf(torque: Torque): keyof typeof STATES {
  return torque === null ? "unknown" : torque ? "on" : "off";
}

/** Shows whether the servos hold the arm, with the switch that enables the controls below. */
export function TorquePanel({ obstacles }: { obstacles: readonly Reason[] }) {
  const text = useText();
  const arm = useArmModel();
  const torque = useStore(arm.store, (state) => state.torque);
  const switchingTo = useStore(arm.store, (state) => state.switchingTo);
  const answer = useStore(arm.store, (each) => each.answer);
  const state = stateOf(torque);
  const { title, hint, icon: Icon } = STATES[state];
  const blocker = torqueObstacles(obstacles, state !== "on")[0];
  const isStopped = obstacles.some(({ key }) => key === "why_estop");
  const isSwitching = switchingTo !== null;

  return (
    <section
      aria-label={text("arm_torque")}
      className={cn(
        "panel flex flex-wrap items-center gap-x-4 gap-y-3 px-4 py-3",
        state === "on" && "border-alive-2",
        state !== "on" && "border-attention/60",
      )}
    >
      <span
        aria-hidden="true"
        className={cn(
          "grid size-12 shrink-0 place-items-center rounded-full",
          state === "on" ? "bg-alive text-alive-ink" : "border-2 border-attention text-attention",
        )}
      >
        <Icon className="size-6" />
      </span>
      <div role="status" className="min-w-0 grow basis-48">
        <p className="text-lg leading-tight font-bold">{text(title)}</p>
        <p className={cn("text-xs", blocker === undefined ? "text-text-2" : "text-attention")}>
          {blocker !== undefined ? text("arm_torque_blocked", { reason: text(blocker.key, blocker.values) }) : text(isStopped ? "arm_enable_while_stopped" : hint)}
          {answer !== "" && <span className="block text-text-3">{text("arm_answer", { answer })}</span>}
        </p>
      </div>
      {state === "on" ? (
          <HoldButton tone="dark" disabled={isSwitching || blocker !== undefined} onHeld={() => void arm.switchTorque(false)}>
            {isSwitching ? text("arm_switching") : text("arm_disable")}
          </HoldButton>
        ) : (
          <Button
            kind="primary"
            className="h-11"
            disabled={isSwitching || blocker !== undefined}
            data-testid="enable-torque"
            onClick={() => void arm.switchTorque(true)}
          >
            {isSwitching ? text("arm_switching") : text("arm_enable")}
          </Button>
        )}
    </section>
  );
}
