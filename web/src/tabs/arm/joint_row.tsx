import { Check, ChevronsRight, CircleDashed, Minus, Plus, TriangleAlert, Unplug } from "lucide-react";
import type { ComponentType } from "react";
import { useStore } from "zustand";
import { JOINTS } from "@/generated/graph";
import { useNow } from "@/hooks/use_now";
import { type TextKey, useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { fixed } from "@/ui/numbers";
import { SpringNumber } from "@/widgets/spring_number";
import { useArmModel } from "./arm_model";
import { type JointPhase, jointPhase } from "./commands";
import { JointSlider } from "./joint_slider";
import type { Joint } from "./joints";

const NUDGE_DEG = 5;

export const PHASES: Record<JointPhase, { label: TextKey; icon: ComponentType<{ className?: string }>; tone: string }> = {
  unknown: { label: "arm_no_feedback", icon: Unplug, tone: "text-text-3" },
  idle: { label: "arm_idle", icon: CircleDashed, tone: "text-text-3" },
  moving: { label: "arm_moving", icon: ChevronsRight, tone: "text-alive" },
  settled: { label: "arm_settled", icon: Check, tone: "text-text-2" },
  stalled: { label: "arm_stalled", icon: TriangleAlert, tone: "text-attention" },
};

interface JointRowProps {
  joint: Joint;
  last: number | undefined;
  measured: number | undefined;
  disabled: boolean;
}

/** A joint: its measured and its commanded angle, and whether it has been reached; below, the slider and the nudge buttons. */
export function JointRow({ joint, last, measured, disabled }: JointRowProps) {
  const text = useText();
  const arm = useArmModel();
  const thumb = useStore(arm.store, ({ thumbs }) => thumbs[joint.name]);
  const command = useStore(arm.store, ({ commands }) => commands[joint.name]);
  const phase = jointPhase(joint, command, measured, useNow());
  const { label, icon: Icon, tone } = PHASES[phase];
  const value = thumb ?? last;
  const name = text(joint.label);
  const isGripper = joint.name === JOINTS.gripper;

  function nudge(degrees: number): void {
    if (value !== undefined) arm.move(joint, Math.round(value + degrees), measured);
  }

  return (
    <li className="flex grow flex-col justify-center border-line pt-1 pb-1.5 not-last:border-b">
      <div className="flex min-h-8 items-center gap-3">
        <p className="flex min-w-0 grow flex-wrap items-baseline gap-x-2 gap-y-1">
          <span className="text-base font-semibold">{name}</span>
          {!isGripper && <span className="text-xs text-text-3">{text(joint.hint)}</span>}
          {isGripper && (
            <span className="rounded-sm border border-attention/50 px-1.5 py-0.5 text-xs whitespace-nowrap text-attention">
              {text("arm_unverified")}
            </span>
          )}
        </p>
        <p className={cn("flex shrink-0 items-center gap-1.5 text-right text-sm leading-tight", tone)}>
          <Icon className="size-4 shrink-0" aria-hidden="true" />
          <span>
            {text(label)}
            {command !== undefined && phase !== "settled" && (
              <span className="block text-xs whitespace-nowrap numeric">{text("arm_asked", { angle: fixed(command.targetDeg, 0) })}</span>
            )}
          </span>
        </p>
        <p className={cn("w-[5.4ch] shrink-0 text-right text-xl leading-none font-bold whitespace-nowrap", measured === undefined && "text-text-3")}>
          <SpringNumber value={last} places={1} className="tabular-nums slashed-zero" />
          <span className="text-lg font-normal text-text-3">°</span>
        </p>
      </div>
      <div className="flex items-center gap-1">
        <Button size="icon" kind="quiet" disabled={disabled} aria-label={text("arm_nudge_down", { joint: name, angle: NUDGE_DEG })} onClick={() => nudge(-NUDGE_DEG)}>
          <Minus />
        </Button>
        <JointSlider
          endLabels={isGripper ? [text("arm_open"), text("arm_closed")] : [`${fixed(joint.lowerDeg, 0)}°`, `${fixed(joint.upperDeg, 0)}°`]}
          joint={joint}
          label={name}
          thumbDeg={value}
          measuredDeg={last}
          commandedDeg={command?.targetDeg}
          disabled={disabled}
          onDrag={(degrees) => arm.setThumb(joint, degrees)}
          onCommit={(degrees) => arm.move(joint, degrees, measured)}
          onCancel={() => arm.follow(joint)}
        />
        <Button size="icon" kind="quiet" disabled={disabled} aria-label={text("arm_nudge_up", { joint: name, angle: NUDGE_DEG })} onClick={() => nudge(NUDGE_DEG)}>
          <Plus />
        </Button>
      </div>
    </li>
  );
}
