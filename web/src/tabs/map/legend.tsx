import type { ReactNode } from "react";
import { useTimeValue } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import { OLD_PLAN } from "@/map/draw/ink";
import { SCAN_STALE_MS, liveMap } from "@/map/live_map";
import { shownPlan } from "@/map/route";
import { shownSightings } from "@/map/sightings";
import { useIsStopped } from "@/map/use_mission";

/** What the lines on the map are; a line that is not drawn now is not explained. */
export function Legend() {
  const text = useText();
  const isStopped = useIsStopped() === true;
  const hasBug = useTimeValue(() => liveMap.tags.some((tag) => tag.hasBug));
  const plan = useTimeValue((now) => {
    const shown = shownPlan(liveMap.plan, liveMap.pose, now);
    return shown === null ? "none" : shown.isFollowed ? "new" : "old";
  });
  const isPlanOld = plan === "old" || isStopped;
  const hasTrail = useTimeValue(() => liveMap.trail.points.length > 1);
  const hasScan = useTimeValue((now) => liveMap.scan !== null && now - liveMap.scan.receivedMs < SCAN_STALE_MS);
  const hasSighting = useTimeValue((now) => shownSightings(liveMap.sightings, now).length > 0);
  return (
    <ul className="flex min-w-0 flex-wrap gap-x-4 gap-y-1 text-xs text-text-2 max-md:hidden">
      {plan !== "none" && (
        <Item label={text(isPlanOld ? "map_legend_old_plan" : "map_legend_plan")}>
          <line x1="0" x2="22" y1="5" y2="5" strokeWidth="3" {...(isPlanOld ? { stroke: OLD_PLAN, strokeDasharray: "2 4" } : { stroke: "var(--color-alive)" })} />
        </Item>
      )}
      {hasTrail && (
        <Item label={text("map_legend_trail")}>
          <line x1="0" x2="22" y1="5" y2="5" stroke="var(--color-alive-2)" strokeWidth="3" />
        </Item>
      )}
      {hasScan && (
        <Item label={text("map_legend_scan")}>
          <line x1="1" x2="22" y1="5" y2="5" stroke="var(--color-sensed)" strokeWidth="3" strokeDasharray="2 4" />
        </Item>
      )}
      {hasSighting && (
        <Item label={text("map_legend_sighting")}>
          <circle cx="11" cy="5" r="3" fill="none" stroke="var(--color-sensed)" strokeWidth="1.5" />
          <circle cx="11" cy="5" r="4.5" fill="none" stroke="var(--color-sensed)" strokeWidth="0.75" />
        </Item>
      )}
      {hasBug && (
        <Item label={text("map_legend_bug")}>
          <circle cx="11" cy="5" r="4" fill="none" stroke="var(--color-attention)" strokeWidth="1.5" strokeDasharray="2 2" />
        </Item>
      )}
    </ul>
  );
}

function Item({ label, children }: { label: string; children: ReactNode }) {
  return (
    <li className="flex items-center gap-1.5">
      <svg aria-hidden="true" width="22" height="10">
        {children}
      </svg>
      {label}
    </li>
  );
}
