import { TOPICS } from "@/generated/graph";
import { useTopic } from "@/hooks/use_topic";
import { useText } from "@/i18n/text";
import { useSetting } from "@/state/settings";
import { ARM, type Joint, clampToLimits, measuredAngles } from "@/tabs/arm/joints";
import { Panel } from "@/ui/panel";
import { useFreshness } from "@/widgets/freshness";
import { SpringNumber } from "@/widgets/spring_number";

/** Angle of each joint of the arm, drawn within its limits. */
export function JointsPanel({ className }: { className?: string }) {
  const text = useText();
  const name = useSetting("jointStatesTopic");
  const sample = useTopic({ name, type: TOPICS.JOINT_STATES.type }, { throttleMs: 100 });
  const { panel } = useFreshness(name, sample?.receivedMs);
  const angles = sample === undefined ? {} : measuredAngles(sample.message);
  return (
    <Panel title={text("telemetry_joints")} aside={text("telemetry_degrees")} {...panel} {...(className === undefined ? {} : { className })}>
      <ul className="flex h-full flex-col">
        {ARM.map((joint) => (
          <li key={joint.name} className="flex min-h-6 grow items-center gap-4">
            <span className="w-20 shrink-0 text-text-2">{text(joint.label)}</span>
            <Bar joint={joint} degrees={angles[joint.name]} />
            <span className="w-[6ch] shrink-0 text-right text-lg font-semibold">
              <SpringNumber value={angles[joint.name]} places={1} flashFrom={2} className="tabular-nums slashed-zero" />
            </span>
          </li>
        ))}
      </ul>
    </Panel>
  );
}

function Bar({ joint, degrees }: { joint: Joint; degrees: number | undefined }) {
  const range = joint.upperDeg - joint.lowerDeg;
  const percent = (angle: number) => ((clampToLimits(joint, angle) - joint.lowerDeg) / range) * 100;
  const zero = percent(0);
  const at = degrees === undefined ? zero : percent(degrees);
  return (
    <span aria-hidden="true" className="relative h-1.5 grow rounded-full bg-raised outline outline-line">
      <span className="absolute inset-y-0 rounded-full bg-sensed" style={{ left: `${Math.min(zero, at)}%`, right: `${100 - Math.max(zero, at)}%` }} />
      <span className="absolute -inset-y-1 w-px bg-line-strong" style={{ left: `${zero}%` }} />
      {degrees !== undefined && <span className="absolute -inset-y-1 w-1 -translate-x-1/2 rounded-full bg-sensed" style={{ left: `${at}%` }} />}
    </span>
  );
}
