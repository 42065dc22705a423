import { X } from "lucide-react";
import { useTimeValue } from "@/hooks/use_now";
import { type Text, useText } from "@/i18n/text";
import { type Sensor, idealRange, judge } from "@/map/health";
import { liveMap } from "@/map/live_map";
import { toggleTag, useMapUi } from "@/map/map_ui";
import { lengthOf, shownPlan } from "@/map/route";
import { HEALTH_NAMES, SENSOR_NAMES, writeLength, writeValue } from "@/map/sensor_text";
import { speciesName } from "@/map/species";
import { targetOf, useIsStopped, useMissionState } from "@/map/use_mission";
import { type Tag, knownSensors } from "@/map/twin";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { fixed, formatDuration } from "@/ui/numbers";
import { Panel } from "@/ui/panel";
import { BugMark, FlowerMark, HealthMark } from "./marks";
import { useAgeText, useTwin } from "./use_tags";

/** The tag that the mission drives to, or the one that was selected, with its readings and their ideal ranges. */
export function TargetPanel({ className }: { className?: string }) {
  const text = useText();
  const mission = useMissionState();
  const { tags, receivedMs, isStale } = useTwin();
  const selected = useMapUi((state) => state.selected);
  const target = targetOf(mission);
  const shown = selected ?? (target === "" ? null : target);
  const isTarget = shown !== null && shown === target;
  const onHold = useIsStopped() === true || mission?.paused === true;
  const tag = tags.find(({ id }) => id === shown);
  const title = !isTarget ? text(shown === null ? "map_no_target" : "map_selected_tag") : text(onHold ? "map_target_hold" : "map_next_target");
  const aside = isTarget ? (
    <DistanceLeft onHold={onHold} />
  ) : shown !== null ? (
    <Button kind="quiet" size="small" aria-label={text("map_clear_selection")} onClick={() => toggleTag(shown)} className="-my-2 -mr-2 px-2">
      <X />
    </Button>
  ) : undefined;
  return (
    <Panel title={title} aside={aside} {...(isStale ? { tone: "stale" as const } : {})} {...(className === undefined ? {} : { className })}>
      {shown === null ? (
        <p className="pb-1 text-text-2">{text("map_no_target_hint")}</p>
      ) : (
        <>
          <Heading id={shown} tag={tag} text={text} />
          {tag !== undefined && <Readings tag={tag} />}
          <p className="pt-1 text-text-3">{tag === undefined ? text("map_unknown_tag") : <ReadAge tag={tag} receivedMs={receivedMs} isTarget={isTarget} />}</p>
        </>
      )}
    </Panel>
  );
}

function ReadAge({ tag, receivedMs, isTarget }: { tag: Tag; receivedMs: number | null; isTarget: boolean }) {
  const text = useText();
  const age = useAgeText(knownSensors(tag).length === 0 ? null : tag.ageS, receivedMs, formatDuration, "");
  return age === "" ? text("map_never_read") : text(isTarget ? "map_read_again" : "map_read_ago", { age });
}

function Heading({ id, tag, text }: { id: string; tag: Tag | undefined; text: Text }) {
  const name = tag === undefined ? null : speciesName(tag.species);
  const count = tag?.flowerCount ?? 0;
  return (
    <div className="flex items-center gap-4 pb-2">
      <p className="max-w-40 truncate text-2xl leading-none font-bold">{id}</p>
      {tag !== undefined && (
        <div className="min-w-0 text-base leading-snug max-md:text-sm">
          <p className="flex items-center gap-2">
            <HealthMark state={tag.health.state} className="size-3.5" />
            {text(HEALTH_NAMES[tag.health.state])}
          </p>
          <p className="flex items-center gap-2 text-text-2">
            {count > 0 || tag.species !== "" ? <FlowerMark species={tag.species} className="mx-px" /> : null}
            <span className="truncate">
              {count === 0 && tag.species === "" ? text("map_without_flowers") : name === null ? tag.species : text(name)}
              {count > 1 && ` × ${count}`}
            </span>
            {tag.hasBug && <BugMark label={text("map_bug")} />}
          </p>
        </div>
      )}
    </div>
  );
}

function DistanceLeft({ onHold }: { onHold: boolean }) {
  const text = useText();
  return useTimeValue((now) => {
    const { plan, pose, speedMps } = liveMap;
    if (pose === null) return null;
    const shown = shownPlan(plan, pose, onHold && plan !== null ? plan.receivedMs : now);
    if (shown === null || !shown.isFollowed) return null;
    const length = writeLength(lengthOf(shown.left));
    if (onHold || speedMps === null || speedMps < 0.02) return text("map_to_go", { length });
    return text("map_to_go_at", { length, speed: `${fixed(speedMps, 2)} m/s` });
  });
}

/** At most two readings are large; more are rows. */
function Readings({ tag }: { tag: Tag }) {
  const sensors = knownSensors(tag);
  const isLarge = sensors.length <= 2;
  return (
    <dl className={cn("grid gap-y-2", isLarge && "max-md:grid-cols-2 max-md:gap-x-4")}>
      {sensors.map((sensor) => (
        <ReadingRow key={sensor} sensor={sensor} value={tag.readings[sensor] ?? NaN} isLarge={isLarge} />
      ))}
    </dl>
  );
}

function ReadingRow({ sensor, value, isLarge }: { sensor: Sensor; value: number; isLarge: boolean }) {
  const text = useText();
  const range = idealRange(sensor);
  const place = judge(sensor, value).side;
  return (
    <div className={cn("grid items-center gap-x-4", isLarge ? "grid-cols-[9rem_minmax(0,1fr)] max-md:grid-cols-1" : "grid-cols-[5.5rem_6.5rem_minmax(0,1fr)]")}>
      <dt className={cn("text-text-2", isLarge && "col-span-full text-xs")}>{text(SENSOR_NAMES[sensor])}</dt>
      <dd className={cn("font-bold whitespace-nowrap", isLarge ? "text-xl leading-tight" : "text-lg leading-tight", place !== "ideal" && "text-attention")}>
        <span className="numeric">{writeValue(sensor, value)}</span>
        <span className="ml-1 text-sm font-normal text-text-3">{range.unit}</span>
        {place !== "ideal" && (
          <span className="ml-1 text-sm">
            <span aria-hidden="true">{place === "low" ? "▼" : "▲"}</span>
            <span className="sr-only">{text(place === "low" ? "map_too_low" : "map_too_high")}</span>
          </span>
        )}
      </dd>
      <dd>
        <RangeBar value={value} low={range.low} high={range.high} />
      </dd>
    </div>
  );
}

/** Where a value lies relative to its ideal range, which is the middle of the bar. */
function RangeBar({ value, low, high }: { value: number; low: number; high: number }) {
  const start = low - (high - low) * 0.4;
  const end = high + (high - low) * 0.4;
  const place = (at: number) => `${Math.min(100, Math.max(0, ((at - start) / (end - start)) * 100))}%`;
  return (
    <div aria-hidden="true" className="relative pt-1 pb-4">
      <div className="h-1.5 rounded-full bg-raised">
        <div className="absolute h-1.5 bg-[#2b6b3f]" style={{ left: place(low), width: `calc(${place(high)} - ${place(low)})` }} />
      </div>
      <span className="absolute top-0 h-3.5 w-1 -translate-x-1/2 rounded-full bg-text ring-2 ring-panel" style={{ left: place(value) }} />
      {[low, high].map((bound) => (
        <span key={bound} className="absolute bottom-0 -translate-x-1/2 text-xs leading-none text-text-3 numeric" style={{ left: place(bound) }}>
          {bound}
        </span>
      ))}
    </div>
  );
}
