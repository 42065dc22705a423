import { type ReactNode, useState } from "react";
import { TOPICS } from "@/generated/graph";
import { type Text, useText } from "@/i18n/text";
import { type HealthState, type Sensor, judge } from "@/map/health";
import { toggleTag, useMapUi } from "@/map/map_ui";
import { HEALTH_NAMES, shortUnit, writeValue } from "@/map/sensor_text";
import { targetOf, useMissionState } from "@/map/use_mission";
import { type Tag, type TagOrder, knownSensors, sortTags } from "@/map/twin";
import { Announced } from "@/ui/announced";
import { cn } from "@/ui/cn";
import { UNKNOWN, clock, fixed, formatDuration } from "@/ui/numbers";
import { BugMark, FlowerMark, HealthMark } from "./marks";
import { useAgeText, useTwin } from "./use_tags";

/** Every tag that the twin knows, the worst first. */
export function GreenhouseTable() {
  const text = useText();
  const { tags, isStale, receivedMs } = useTwin();
  const [order, setOrder] = useState<TagOrder>("health");
  const selected = useMapUi((state) => state.selected);
  const target = targetOf(useMissionState());
  const topic = TOPICS.TWIN_STATE.name;
  if (receivedMs === null) return <Empty title={text("no_sample_yet", { topic })} />;
  return (
    <div className="flex h-full min-h-0 flex-col">
      <div className="flex items-center gap-3 py-1 pr-2 pl-4 text-xs text-text-3">
        <p className="grow">{summary(text, tags)}</p>
        <select
          aria-label={text("map_sort")}
          value={order}
          onChange={(event) => setOrder(event.target.value as TagOrder)}
          className="h-8 rounded-sm border border-transparent bg-panel px-1 text-text-2 hover:border-line max-xl:h-11 pointer-coarse:h-11"
        >
          <option value="health">{text("map_sort_health")}</option>
          <option value="id">{text("map_sort_id")}</option>
          <option value="age">{text("map_sort_age")}</option>
        </select>
      </div>
      {tags.length === 0 ? (
        <Empty title={text("map_no_tags")}>{text("map_no_tags_hint")}</Empty>
      ) : (
        <div className={cn("min-h-0 grow overflow-y-auto", isStale && "hatched text-text-3")}>
          <table className="w-full border-collapse text-left">
            <thead className="sticky top-0 z-10 bg-panel text-xs text-text-2">
              <tr className="border-b border-line">
                <th scope="col" colSpan={2} className="py-1.5 pl-4 font-normal">
                  {text("map_column_tag")}
                </th>
                <th scope="col" className="py-1.5 pr-3 font-normal">
                  {text("map_column_flowers")}
                </th>
                <th scope="col" className="py-1.5 font-normal">
                  {text("map_column_readings")}
                </th>
                <th scope="col" className="py-1.5 pr-4 text-right font-normal">
                  {text("map_column_age")}
                </th>
              </tr>
            </thead>
            <tbody>
              {sortTags(tags, order).map((tag) => (
                <Row key={tag.id} tag={tag} receivedMs={receivedMs} isSelected={tag.id === selected} isTarget={tag.id === target} text={text} />
              ))}
            </tbody>
          </table>
        </div>
      )}
      {isStale && (
        <p className="border-t border-line px-4 py-2 text-xs text-attention">
          <Announced says={text("is_silent", { topic: TOPICS.TWIN_STATE.name })}>
            <StaleText receivedMs={receivedMs} />
          </Announced>
        </p>
      )}
    </div>
  );
}

function StaleText({ receivedMs }: { receivedMs: number }) {
  const text = useText();
  return text("stale_since", { topic: TOPICS.TWIN_STATE.name, age: useAgeText(0, receivedMs, formatDuration, UNKNOWN) });
}

function summary(text: Text, tags: readonly Tag[]): string {
  const count = (holds: (tag: Tag) => boolean) => tags.filter(holds).length;
  const inState = (state: HealthState) => count((tag) => tag.health.state === state);
  const parts: [number, string][] = [
    [inState("critical"), "map_critical_count"],
    [inState("stressed"), "map_stressed_count"],
    [inState("off_range"), "map_off_range_count"],
    [count((tag) => tag.hasBug), "map_bug_count"],
  ];
  const all = text("map_tag_count", { count: tags.length });
  return [all, ...parts.filter(([number]) => number > 0).map(([number, key]) => text(key as "map_bug_count", { count: number }))].join(" · ");
}

function Empty({ title, children }: { title: string; children?: ReactNode }) {
  return (
    <div className="px-4 py-3 text-text-2">
      <p className="font-semibold">{title}</p>
      {children !== undefined && <p className="text-sm text-text-3">{children}</p>}
    </div>
  );
}

interface RowProps {
  tag: Tag;
  receivedMs: number;
  isSelected: boolean;
  isTarget: boolean;
  text: Text;
}

function Row({ tag, receivedMs, isSelected, isTarget, text }: RowProps) {
  return (
    <tr
      onClick={() => toggleTag(tag.id)}
      className={cn("cursor-pointer border-b border-line hover:bg-hover", isTarget && "bg-alive-wash", isSelected && "bg-raised outline-2 -outline-offset-2 outline-text-2")}
    >
      <td className={cn("w-9 border-l-4 py-0 pl-3", isTarget ? "border-alive" : "border-transparent")}>
        <HealthMark state={tag.health.state} />
      </td>
      <td className="py-0 pr-2">
        <button
          type="button"
          aria-pressed={isSelected}
          aria-label={text("map_show_tag", { tag: tag.id, health: text(HEALTH_NAMES[tag.health.state]) })}
          onClick={(event) => {
            event.stopPropagation();
            toggleTag(tag.id);
          }}
          className="min-h-8 max-w-20 truncate text-left text-base font-bold pointer-coarse:min-h-11 max-xl:min-h-11"
        >
          {tag.id}
        </button>
      </td>
      <td className="pr-2 whitespace-nowrap">
        {tag.flowerCount === 0 && tag.species === "" ? (
          <span className="text-text-3">{text("map_no_flowers")}</span>
        ) : (
          <span className="inline-flex items-center gap-1.5">
            <FlowerMark species={tag.species} />
            <span className="numeric">{fixed(tag.flowerCount, 0)}</span>
            {tag.hasBug && <BugMark label={text("map_bug")} />}
          </span>
        )}
      </td>
      <td className="pr-2 leading-snug">
        {knownSensors(tag).map((sensor) => (
          <Value key={sensor} sensor={sensor} value={tag.readings[sensor] ?? NaN} text={text} />
        ))}
      </td>
      <td className="pr-4 text-right whitespace-nowrap text-text-2 numeric">{useAgeText(tag.ageS, receivedMs, clock, UNKNOWN)}</td>
    </tr>
  );
}

function Value({ sensor, value, text }: { sensor: Sensor; value: number; text: Text }) {
  const place = judge(sensor, value).side;
  const unit = shortUnit(sensor);
  return (
    <span className="mr-2.5 inline-block whitespace-nowrap">
      <span className={cn("numeric", place !== "ideal" && "font-semibold text-attention")}>
        {writeValue(sensor, value)}
        {place !== "ideal" && (
          <>
            <span aria-hidden="true" className="text-xs">
              {place === "low" ? "▼" : "▲"}
            </span>
            <span className="sr-only"> {text(place === "low" ? "map_too_low" : "map_too_high")}</span>
          </>
        )}
      </span>
      <span className="ml-0.5 text-xs text-text-3">{"key" in unit ? text(unit.key) : unit.raw}</span>
    </span>
  );
}
