import { Bell, CircleAlert, Flag, Footprints, Gamepad2, type LucideIcon, OctagonX, Pause, Radar, Waypoints } from "lucide-react";
import { useState } from "react";
import { explained, namedIn, wordsIn } from "@/i18n/robot_words";
import { type Language, type TextValues, useLanguage, useText } from "@/i18n/text";
import type { EventKind } from "@/map/events";
import { type LoggedEvent, collapseEvents, useMissionLog } from "@/map/mission_log";
import { useRewind } from "@/state/rewind";
import { cn } from "@/ui/cn";
import { writeMoment } from "@/ui/numbers";
import { RobotWords } from "@/ui/robot_words";
import { Segments } from "@/ui/segments";

const ICONS: Record<EventKind, LucideIcon> = {
  lifecycle: Flag,
  phase: Footprints,
  target: Waypoints,
  pause: Pause,
  estop: OctagonX,
  control: Gamepad2,
  fault: CircleAlert,
  observation: Radar,
  notice: Bell,
};

type Filter = "all" | "tags" | "problems";

function passes(event: LoggedEvent, filter: Filter): boolean {
  if (filter === "tags") return event.kind === "observation" || event.kind === "target";
  return filter === "all" || event.severity !== "info" || event.kind === "estop";
}

/** The mission's last events, the newest first. */
export function EventList() {
  const text = useText();
  const events = useMissionLog((log) => log.events);
  const [filter, setFilter] = useState<Filter>("all");
  const shownS = useRewind((state) => state.shownS);
  const shown = events.filter((event) => passes(event, filter) && (shownS === null || event.timeS <= shownS));
  return (
    <div>
      <div className="sticky top-0 bg-panel px-4 py-2">
        <Segments
          label={text("mission_events")}
          value={filter}
          options={[
            { value: "all", label: text("mission_events_all") },
            { value: "tags", label: text("mission_events_tags") },
            { value: "problems", label: text("mission_events_problems") },
          ]}
          onChange={setFilter}
        />
      </div>
      {shown.length === 0 && <p className="px-4 py-2 text-text-2">{text(events.length === 0 ? "mission_events_empty" : "mission_events_none_of_kind")}</p>}
      <ol aria-label={text("mission_events")}>
        {collapseEvents(shown).map(({ event, count }) => (
          <EventRow key={event.number} event={event} count={count} />
        ))}
      </ol>
    </div>
  );
}

function EventRow({ event, count }: { event: LoggedEvent; count: number }) {
  const text = useText();
  const language = useLanguage((store) => store.language);
  const Icon = ICONS[event.kind];
  return (
    <li className="flex items-baseline gap-3 border-b border-line px-4 py-1.5">
      <time className="shrink-0 text-xs text-text-3 numeric">{writeMoment(event.timeS)}</time>
      <Icon
        aria-hidden="true"
        className={cn("size-3.5 shrink-0 self-center text-text-3", event.severity === "warn" && "text-attention", event.severity === "error" && "text-stop-text")}
      />
      <span className={cn("min-w-0 grow break-words", event.severity === "error" && "text-stop-text")}>
        {"key" in event.text ? text(event.text.key, inWords(language, event.text.values)) : <RobotWords words={event.text.raw.slice(0, 300)} />}
        {count > 1 && <span className="ml-2 text-text-3 tabular-nums">× {count}</span>}
      </span>
      <span className="shrink-0 text-xs text-text-3">{text(`mission_kind_${event.kind}`)}</span>
    </li>
  );
}

/** With names, and the code of an observation's detail, if there is one, in words. */
function inWords(language: Language, values: TextValues = {}): TextValues {
  const { detail } = values;
  const named = namedIn(language, values);
  return typeof detail === "string" ? { ...named, detail: wordsIn(language, explained(detail)) } : named;
}
