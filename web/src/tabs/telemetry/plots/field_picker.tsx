import { Plus } from "lucide-react";
import { useEffect, useId, useState } from "react";
import { SERVICES } from "@/generated/graph";
import { useTopic } from "@/hooks/use_topic";
import { useText } from "@/i18n/text";
import { call } from "@/robot/commands";
import { Button } from "@/ui/button";
import { Dialog } from "@/ui/dialog";
import { fixed } from "@/ui/numbers";
import { numericFields, valueAt } from "../fields";
import { MAX_SERIES, addSeries, plottableTopics, usePlots } from "./plot_store";
import { anyTopic } from "./recorder";

const INPUT = "min-h-11 w-full rounded-md border border-line-strong bg-well px-3 text-sm text-text numeric";
const SHOWN_FIELDS = 120;

/** Picks a topic, then one of its numeric fields. */
export function FieldPicker({ onClose }: { onClose: () => void }) {
  const text = useText();
  const id = useId();
  const [found, setFound] = useState<{ topics: string[]; types: string[] } | null>(null);
  const [topic, setTopic] = useState("");
  const topics = plottableTopics(found);
  const type = topics.find(({ name }) => name === topic)?.type;

  useEffect(() => {
    // If the list of existing topics is not available, the graph's table is offered instead.
    call(SERVICES.TOPICS, {})
      .then((answer) => setFound(answer))
      .catch(() => setFound(null));
  }, []);

  return (
    <Dialog open onOpenChange={(open) => !open && onClose()} title={text("telemetry_add_title")} description={text("telemetry_add_explained", { count: MAX_SERIES })} className="h-[min(640px,calc(100dvh-2rem))]">
      <div className="flex flex-col gap-4">
        <label htmlFor={id} className="flex flex-col gap-1.5 text-sm text-text-2">
          {text("telemetry_topic")}
          <select id={id} value={topic} onChange={(event) => setTopic(event.target.value)} className={INPUT}>
            <option value="" disabled>
              {text("telemetry_choose_topic")}
            </option>
            {topics.map(({ name }) => (
              <option key={name} value={name}>
                {name}
              </option>
            ))}
          </select>
        </label>
        {type !== undefined && <FieldList key={topic} topic={topic} type={type} />}
      </div>
    </Dialog>
  );
}

function FieldList({ topic, type }: { topic: string; type: string }) {
  const text = useText();
  const id = useId();
  const [filter, setFilter] = useState("");
  const series = usePlots((state) => state.series);
  const sample = useTopic(anyTopic(topic, type), { throttleMs: 250 });
  const typed = filter.trim();
  if (sample === undefined) return <p className="text-text-2">{text("telemetry_waiting_for", { topic, type })}</p>;
  const all = numericFields(sample.message, 400);
  const listed = all.filter(({ path }) => path.includes(typed)).slice(0, SHOWN_FIELDS);
  // An element beyond the listed ones of a long array can be typed.
  const own = valueAt(sample.message, typed);
  if (typed !== "" && Number.isFinite(own) && !listed.some(({ path }) => path === typed)) listed.unshift({ path: typed, value: own });
  const isFull = series.length >= MAX_SERIES;
  return (
    <>
      <label htmlFor={id} className="flex flex-col gap-1.5 text-sm text-text-2">
        {text("telemetry_field")}
        <input id={id} value={filter} onChange={(event) => setFilter(event.target.value)} placeholder="linear.x, ranges[200]" autoComplete="off" autoCapitalize="none" spellCheck={false} className={INPUT} />
      </label>
      {listed.length === 0 && <p className="text-text-2">{text(all.length === 0 ? "telemetry_no_fields" : "telemetry_no_such_field", { type })}</p>}
      <ul className="flex flex-col">
        {listed.map(({ path, value }) => {
          const isPlotted = series.some((each) => each.id === `${topic} ${path}`);
          return (
            <li key={path} className="flex items-center gap-3 border-t border-line">
              <span className="min-w-0 grow text-sm break-all numeric">{path}</span>
              <span className="text-sm whitespace-nowrap text-text-3 numeric">{fixed(value, Number.isInteger(value) ? 0 : 3)}</span>
              <Button size="small" disabled={isPlotted || isFull} aria-label={text("telemetry_plot_field", { field: path })} onClick={() => addSeries([{ topic, type, path }])} className="my-1">
                <Plus />
                {isPlotted ? text("telemetry_plotted") : text("telemetry_plot")}
              </Button>
            </li>
          );
        })}
      </ul>
    </>
  );
}
