/** What both views draw beside the data. */
import { useMemo, useSyncExternalStore } from "react";
import { useConsole } from "@/api/console_store";
import { useTimeValue } from "@/hooks/use_now";
import { useLink } from "@/robot/link";
import { useIsRewound } from "@/state/rewind";
import { useSetting } from "@/state/settings";
import { POSE_STALE_MS, liveMap } from "./live_map";
import { approachPose } from "./approaches";
import { useMapUi } from "./map_ui";
import type { Presentation } from "./renderer";
import { targetOf, useIsStopped, useMissionState } from "./use_mission";

const PHONE = window.matchMedia("(max-width: 767.98px)");

export function useIsPhone(): boolean {
  return useSyncExternalStore(
    (changed) => {
      PHONE.addEventListener("change", changed);
      return () => PHONE.removeEventListener("change", changed);
    },
    () => PHONE.matches,
  );
}

/** Whether the robot's place is known, and up to date. */
export function usePoseState(): { isKnown: boolean; isStale: boolean } {
  const linkOpen = useLink((link) => link.state === "open");
  const isRewound = useIsRewound();
  const isKnown = useTimeValue(() => liveMap.pose !== null);
  const isOld = useTimeValue((now) => liveMap.poseReceivedMs !== null && now - liveMap.poseReceivedMs > POSE_STALE_MS);
  return { isKnown, isStale: isKnown && (isOld || (!linkOpen && !isRewound)) };
}

export function usePresentation(): Presentation {
  const { layer, isFollowing, draft, preview, sent, selected } = useMapUi();
  const isStopped = useIsStopped() === true;
  const current = targetOf(useMissionState());
  const { isStale: isPoseStale } = usePoseState();
  const turned = useSetting("polarityInvertHmi");
  const isSmall = useIsPhone();
  const sentPose = sent?.pose ?? null;
  const stored = useConsole((state) => (selected === null ? undefined : state.approaches[selected]));
  const approach = useMemo(() => approachPose(stored), [stored]);
  return useMemo(
    () => ({ layer, isFollowing, draft, preview, sent: sentPose, approach, selected, current, isStopped, isPoseStale, turned, isSmall }),
    [layer, isFollowing, draft, preview, sentPose, approach, selected, current, isStopped, isPoseStale, turned, isSmall],
  );
}
