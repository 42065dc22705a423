/** The mission and the stop as the map's panels need them: changes only, of what comes five times a second. */
import { hasControl, useConsole } from "@/api/console_store";
import { TOPICS } from "@/generated/graph";
import type { lupin_msgs_MissionState } from "@/generated/messages";
import { useTimeValue } from "@/hooks/use_now";
import { ESTOP_STALE_MS } from "@/hooks/use_situation";
import { useTopics } from "@/hooks/use_topic";
import { useTopicValue } from "@/hooks/use_topic_value";
import { useLink } from "@/robot/link";
import { useGate } from "@/robot/stop";
import { useIsRewound } from "@/state/rewind";
import type { MissionFacts } from "./mission_rules";
import { useTabRole } from "@/safety/commanding_tab";
import { MISSION_STALE_MS } from "@/state/mission_age";
import { ACTIVE_STATES } from "@/state/sentence";

const FIELDS = [
  "mission_id",
  "mission_type",
  "lifecycle_state",
  "current_target",
  "targets_total",
  "targets_completed",
  "targets_failed",
  "targets_unreachable",
  "targets_skipped",
  "tags_discovered",
  "discovery_goal",
  "estop_engaged",
  "paused",
  "battery_low",
] as const;

export type Mission = Pick<lupin_msgs_MissionState, (typeof FIELDS)[number]> & {
  /** The robot's time, s; 0 before the first mission. */
  startedS: number;
};

export function useMissionState(): Mission | null {
  return useTopicValue(TOPICS.MISSION_STATE, (sample) => {
    if (sample === undefined) return null;
    const { message } = sample;
    const picked = Object.fromEntries(FIELDS.map((name) => [name, message[name]])) as Omit<Mission, "startedS">;
    return { ...picked, startedS: message.started_at.sec };
  });
}

/** Whether nothing was heard of the mission lately. */
export function useIsMissionStale(): boolean {
  const topics = useTopics();
  const isRewound = useIsRewound();
  const linkOpen = useLink((link) => link.state === "open");
  const isOld = useTimeValue((now) => {
    const receivedMs = topics.last(TOPICS.MISSION_STATE)?.receivedMs;
    return receivedMs === undefined || now - receivedMs > MISSION_STALE_MS;
  });
  return isOld || (!linkOpen && !isRewound);
}

export function isRunning(mission: Pick<Mission, "lifecycle_state"> | null): boolean {
  return mission !== null && (ACTIVE_STATES as readonly string[]).includes(mission.lifecycle_state);
}

/** The tag that the mission drives to now, or "". */
export function targetOf(mission: Mission | null): string {
  return mission !== null && isRunning(mission) ? mission.current_target : "";
}

/** The robot's own e-stop; null where it is not known. */
export function useIsStopped(): boolean | null {
  const topics = useTopics();
  const engaged = useTopicValue(TOPICS.ESTOP_STATE, (sample) => sample?.message.data ?? null);
  const isFresh = useTimeValue((now) => {
    const receivedMs = topics.last(TOPICS.ESTOP_STATE)?.receivedMs;
    return receivedMs !== undefined && now - receivedMs < ESTOP_STALE_MS;
  });
  return isFresh ? engaged : null;
}

/** What decides which requests to the mission are possible; `mission` is null where its state is out of date. */
export function useMissionFacts(mission: Mission | null): MissionFacts {
  const linkOpen = useLink((link) => link.state === "open");
  const isViewer = useConsole((state) => state.session?.role === "viewer");
  const isHeldByOther = useConsole((state) => state.control.holder !== null && !hasControl(state));
  const isWatching = useTabRole(({ role }) => role === "watching");
  const isGateClosed = useGate((gate) => gate.engaged);
  const stopped = useIsStopped();
  const isRewound = useIsRewound();
  return { linkOpen, isRewound, isViewer, isHeldByOther, isWatching, stopped, isGateClosed, mission };
}
