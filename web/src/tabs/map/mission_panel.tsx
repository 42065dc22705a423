import { CirclePause, CirclePlay, House, RotateCcw, SkipForward } from "lucide-react";
import { useMemo } from "react";
import { TOPICS } from "@/generated/graph";
import { useTimeValue } from "@/hooks/use_now";
import { useTopics } from "@/hooks/use_topic";
import { type Text, type TextKey, useText } from "@/i18n/text";
import type { Visit } from "@/map/events";
import { useMissionLog } from "@/map/mission_log";
import { ALL_TAGS, ENDS, MISSION_SERVICES, type MissionAction, type MissionFacts, refusal } from "@/map/mission_rules";
import { transitStops } from "@/map/transit";
import { type Mission, isRunning, useIsMissionStale, useMissionFacts, useMissionState } from "@/map/use_mission";
import { call } from "@/robot/commands";
import { useRewind } from "@/state/rewind";
import { showDone, showProblem } from "@/state/problems";
import { Announced } from "@/ui/announced";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { HoldButton } from "@/ui/hold_button";
import { fixed, formatDuration } from "@/ui/numbers";
import { StartForm } from "./start_form";
import { TransitLine } from "./transit_line";
import { useTwin } from "./use_tags";

/** The mission with its controls, and the line of its tags. */
export function MissionPanel({ className }: { className?: string }) {
  const text = useText();
  const mission = useMissionState();
  const isStale = useIsMissionStale();
  const facts = useMissionFacts(isStale ? null : mission);
  const active = isRunning(mission);
  const startRefusal = refusal("start", facts);
  return (
    <section aria-label={text("mission_title")} className={cn("panel flex min-w-0 flex-col", isStale && mission !== null && "hatched", className)}>
      <header className="flex min-h-14 flex-wrap items-center gap-x-4 gap-y-1 px-4 py-2">
        <h2 className="font-semibold text-text-2">{text("mission_title")}</h2>
        <p className="grow text-sm whitespace-nowrap text-text-2 max-md:whitespace-normal">{counts(text, mission)}</p>
        {active && mission !== null && <ActiveControls mission={mission} facts={facts} />}
        {!active && mission !== null && mission.lifecycle_state !== "FAULT" && <StartForm refusal={startRefusal} />}
        {mission?.lifecycle_state === "FAULT" && <Trigger action="reset" facts={facts} label={text("mission_reset")} icon={<RotateCcw />} />}
      </header>
      {mission !== null && mission.mission_id !== "" && <Line mission={mission} isStale={isStale} />}
      {!active && mission !== null && startRefusal !== null && !isStale && <p className="px-4 pb-3 text-sm text-text-2">{text("mission_cannot_start", { reason: text(startRefusal) })}</p>}
      {isStale && (
        <p className="border-t border-line px-4 py-2 text-xs text-attention">
          <Announced says={text("is_silent", { topic: TOPICS.MISSION_STATE.name })}>
            <StaleText />
          </Announced>
        </p>
      )}
    </section>
  );
}

function StaleText() {
  const text = useText();
  const topic = TOPICS.MISSION_STATE.name;
  const topics = useTopics();
  const age = useTimeValue((now) => {
    const receivedMs = topics.last(TOPICS.MISSION_STATE)?.receivedMs;
    return receivedMs === undefined ? "" : formatDuration((now - receivedMs) / 1000);
  });
  return age === "" ? text("mission_nobody", { topic }) : text("stale_since", { topic, age });
}

function counts(text: Text, mission: Mission | null): string {
  if (mission === null || mission.mission_id === "") return text("mission_idle");
  if (mission.lifecycle_state === "EXPLORING" || mission.lifecycle_state === "PREPARE") {
    const { tags_discovered: found, discovery_goal: goal } = mission;
    if (mission.mission_type !== "InspectionMission") return goal >= ALL_TAGS ? text("mission_found", { found }) : text("mission_found_of", { found, goal });
  }
  const [done, failed, unreachable, skipped] = [mission.targets_completed, mission.targets_failed, mission.targets_unreachable, mission.targets_skipped].map(
    (count) => fixed(count, 0),
  ) as [string, string, string, string];
  return text(mission.targets_skipped > 0 ? "mission_counts_skipped" : "mission_counts", { done, failed, unreachable, skipped });
}

function Line({ mission, isStale }: { mission: Mission; isStale: boolean }) {
  const visits = useShownVisits();
  const requested = useMissionLog((log) => log.requested);
  const { tags } = useTwin();
  const { mission_id, lifecycle_state, current_target, targets_total, paused } = mission;
  const visited = mission.targets_completed + mission.targets_failed + mission.targets_unreachable + mission.targets_skipped;
  const stops = useMemo(
    () => transitStops({ mission_id, lifecycle_state, current_target, targets_total, visited }, visits, tags, requested?.missionId === mission_id ? requested.tags : []),
    [mission_id, lifecycle_state, current_target, targets_total, visited, visits, tags, requested],
  );
  return (
    <TransitLine
      stops={stops}
      tags={tags}
      startedS={mission.startedS}
      isPaused={paused}
      isSearching={lifecycle_state === "EXPLORING" && !isStale}
      isReturning={lifecycle_state === "RETURNING"}
      isDone={lifecycle_state === "DONE"}
    />
  );
}

/** The visits up to the shown moment. */
function useShownVisits(): readonly Visit[] {
  const visits = useMissionLog((log) => log.visits);
  const shownS = useRewind((state) => state.shownS);
  return useMemo(() => (shownS === null ? visits : visits.filter(({ timeS }) => timeS <= shownS)), [visits, shownS]);
}

const DOCK_LABELS: Readonly<Record<string, TextKey>> = {
  EXPLORING: "mission_dock_exploring",
  INSPECTING: "mission_dock_inspecting",
  MONITORING: "mission_dock_monitoring",
};

function ActiveControls({ mission, facts }: { mission: Mission; facts: MissionFacts }) {
  const text = useText();
  return (
    <div className="flex flex-wrap items-center gap-2 max-md:w-full max-md:*:grow">
      {mission.paused ? (
        <Trigger action="resume" facts={facts} label={text("mission_resume")} icon={<CirclePlay />} isPrimary />
      ) : (
        <Trigger action="pause" facts={facts} label={text("mission_pause")} icon={<CirclePause />} />
      )}
      {mission.lifecycle_state === "INSPECTING" && (
        <HeldTrigger
          action="skip"
          facts={facts}
          label={mission.current_target === "" ? text("mission_skip_none") : text("mission_skip", { tag: mission.current_target })}
          icon={<SkipForward />}
        />
      )}
      <HeldTrigger action="dock" facts={facts} label={text(DOCK_LABELS[mission.lifecycle_state] ?? "mission_dock")} icon={<House />} />
      <HeldTrigger action="abort" facts={facts} label={text("mission_abort")} />
    </div>
  );
}

/** Whose answer says more than the mission's state will. */
const TOLD: readonly string[] = ["abort", "skip", "dock"];

/** Call a service of the mission, and show what it refuses. */
async function trigger(action: Exclude<MissionAction, "start">): Promise<void> {
  try {
    const { success, message } = await call(MISSION_SERVICES[action], {});
    if (!success) throw new Error(message);
    if (message !== "" && TOLD.includes(action)) showDone(message);
  } catch (error) {
    showProblem(error);
  }
}

interface TriggerProps {
  action: Exclude<MissionAction, "start">;
  facts: MissionFacts;
  label: string;
  icon?: React.ReactNode;
  isPrimary?: boolean;
}

/** For what ends or gives up something: it acts after it was held, and says what it ends. */
function HeldTrigger({ action, facts, label, icon }: TriggerProps) {
  const text = useText();
  const reason = refusal(action, facts);
  const hint = reason ?? ENDS[action];
  return (
    <HoldButton
      tone="dark"
      disabled={reason !== null}
      title={hint === null ? undefined : text(hint)}
      onHeld={() => void trigger(action)}
      className="h-10 max-xl:h-11 pointer-coarse:h-11 [&_svg]:size-4"
    >
      {icon}
      {label}
    </HoldButton>
  );
}

function Trigger({ action, facts, label, icon, isPrimary = false }: TriggerProps) {
  const text = useText();
  const reason = refusal(action, facts);
  return (
    <Button kind={isPrimary ? "primary" : "plain"} disabled={reason !== null} title={reason === null ? undefined : text(reason)} onClick={() => void trigger(action)}>
      {icon}
      {label}
    </Button>
  );
}
