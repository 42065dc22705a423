import { Lock, Ruler } from "lucide-react";
import { TOPICS } from "@/generated/graph";
import { useAge } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import type { Reason } from "@/state/can_drive";
import { useSetting } from "@/state/settings";
import { Button } from "@/ui/button";
import { fixed, formatDuration } from "@/ui/numbers";
import { Panel } from "@/ui/panel";
import { JointRow } from "./joint_row";
import { ARM } from "./joints";
import { JOINTS_STALE_MS, type Measured } from "./use_arm";

interface JointsPanelProps {
  measured: Measured;
  obstacles: readonly Reason[];
  onCalibrate: () => void;
}

export function JointsPanel({ measured, obstacles, onCalibrate }: JointsPanelProps) {
  const text = useText();
  const age = useAge(measured.receivedMs);
  const rate = useSetting("armRateDegPerSec");
  const topic = useSetting("jointStatesTopic") || TOPICS.JOINT_STATES.name;
  const isStale = age !== null && age * 1000 > JOINTS_STALE_MS;
  const first = obstacles[0];
  const notice =
    age === null ? (
      text("no_sample_yet", { topic })
    ) : isStale ? (
      text("stale_since", { topic, age: formatDuration(age) })
    ) : first === undefined ? null : (
      <>
        <Lock aria-hidden="true" className="size-4 shrink-0" />
        {text("arm_blocked", { reason: text(first.key, first.values) })}
      </>
    );
  return (
    <Panel
      title={text("arm_joints")}
      aside={
        <span className="flex items-center gap-3">
          {text("arm_rate", { rate: fixed(rate, 0) })}
          <Button size="small" kind="quiet" className="-mr-3" onClick={onCalibrate}>
            <Ruler />
            {text("arm_calibrate")}
          </Button>
        </span>
      }
      notice={notice}
      {...(age === null ? { tone: "empty" as const } : isStale ? { tone: "stale" as const } : {})}
    >
      <ul className="flex min-h-full flex-col">
        {ARM.map((joint) => (
          <JointRow key={joint.name} joint={joint} last={measured.last[joint.name]} measured={measured.now[joint.name]} disabled={obstacles.length > 0} />
        ))}
      </ul>
    </Panel>
  );
}
