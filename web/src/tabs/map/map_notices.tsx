import { TriangleAlert } from "lucide-react";
import { type ReactNode, useState } from "react";
import { useNow, useTimeValue } from "@/hooks/use_now";
import { TOPICS } from "@/generated/graph";
import { useTopicValue } from "@/hooks/use_topic_value";
import { useText } from "@/i18n/text";
import { liveMap } from "@/map/live_map";
import { usePoseState } from "@/map/use_presentation";
import { useIsRewound, useRewind } from "@/state/rewind";
import { useLink } from "@/robot/link";
import { isRobotLost } from "@/state/sentence";
import { useSetting } from "@/state/settings";
import { Announced } from "@/ui/announced";
import { formatDuration } from "@/ui/numbers";

/** What has only just been asked for is not missing yet. */
const PATIENCE_MS = 3000;

function useIsLate(): boolean {
  const [openedMs] = useState(useNow());
  return useTimeValue((now) => now - openedMs > PATIENCE_MS);
}

/** In the middle of the view, while there is no map to show there. */
export function NoMap() {
  const text = useText();
  const isLate = useIsLate();
  const hasMap = useTimeValue(() => liveMap.grid !== null);
  const linkOpen = useLink((link) => link.state === "open");
  const topic = useSetting("mapTopic");
  const isRewound = useIsRewound();
  const isLoading = useRewind((rewind) => rewind.isLoading);
  if (hasMap || (isRewound ? isLoading : !isLate)) return null;
  return (
    <div role="status" className="pointer-events-none absolute inset-0 grid place-items-center p-6">
      <div className="rounded-lg border border-line bg-panel px-6 py-4 text-center">
        <p className="text-lg font-semibold">{text(isRewound ? "rewind_no_map" : "map_no_map")}</p>
        {isRewound ? null : <p className="text-text-2">{linkOpen ? text("map_no_map_hint", { topic }) : text("map_no_link_hint")}</p>}
      </div>
    </div>
  );
}

/** What else the map lacks, since when, and what helps. */
export function MapNotices({ sceneFailure }: { sceneFailure: string }) {
  const text = useText();
  const { isKnown, isStale } = usePoseState();
  const isWaitingForPlace = useTopicValue(TOPICS.MISSION_STATE, (sample) => isRobotLost(sample?.message ?? null));
  const isLate = useIsLate();
  const hasMap = useTimeValue(() => liveMap.grid !== null);
  const age = useTimeValue((now) => (isStale && liveMap.poseReceivedMs !== null ? formatDuration((now - liveMap.poseReceivedMs) / 1000) : ""));
  const linkOpen = useLink((link) => link.state === "open");
  const [map, base] = [useSetting("mapFrame"), useSetting("baseFrame")];
  return (
    <div role="status" className="flex flex-col items-center gap-2">
      {linkOpen && !isKnown && hasMap && isLate && <Notice>{text("map_no_pose", { map, base })}</Notice>}
      {linkOpen && isWaitingForPlace && <Notice>{text("map_robot_lost")}</Notice>}
      {linkOpen && isStale && !isWaitingForPlace && (
        <Notice>
          <Announced says={text("is_silent", { topic: TOPICS.TF.name })}>{text("map_stale_pose", { age })}</Announced>
        </Notice>
      )}
      {sceneFailure !== "" && <Notice>{text("map_3d_failed", { reason: sceneFailure.slice(0, 120) })}</Notice>}
    </div>
  );
}

function Notice({ children }: { children: ReactNode }) {
  return (
    <p className="flex items-center gap-2 rounded-md border border-line-strong bg-panel px-3 py-2 text-sm text-attention">
      <TriangleAlert aria-hidden="true" className="size-4 shrink-0" />
      {children}
    </p>
  );
}
