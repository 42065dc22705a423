/** Records the plotted fields while the plots are open, and fills them back from the run's recording. */
import { topics } from "@/robot/link";
import type { TopicRow } from "@/ros/topics";
import { TimeSeries } from "@/widgets/time_series";
import { valueAt } from "../fields";
import type { RecordedSample } from "@/rewind/windows";
import { readRunPast, travelTimeS } from "./past";
import { LONGEST_S, type PlotSeries } from "./plot_store";

/** 50 samples a second for five minutes. */
const CAPACITY = 15_000;
const THROTTLE = { throttleMs: 20 };

/** A topic of any type; messages of a type that the table does not know are read by their fields only. */
export function anyTopic(name: string, type: string): TopicRow {
  return { name, type } as TopicRow;
}

export class PlotRecorder {
  private readonly recorded = new Map<string, TimeSeries>();
  private readonly followed = new Map<string, () => void>();
  private plotted: readonly PlotSeries[] = [];
  private readonly fillings = new Set<AbortController>();

  constructor(private readonly readPast: typeof readRunPast = readRunPast) {}

  /** The samples of a series; null before it is recorded. */
  samples(id: string): TimeSeries | null {
    return this.recorded.get(id) ?? null;
  }

  /** Record these series and no others. */
  record(plotted: readonly PlotSeries[]): void {
    this.plotted = plotted;
    for (const id of this.recorded.keys()) if (!plotted.some((each) => each.id === id)) this.recorded.delete(id);
    const added = plotted.filter(({ id }) => !this.recorded.has(id));
    for (const { id } of added) this.recorded.set(id, new TimeSeries(LONGEST_S, CAPACITY));
    const wanted = new Map(plotted.map(({ topic, type }) => [topic, type]));
    for (const [topic, end] of this.followed) {
      if (wanted.has(topic)) continue;
      end();
      this.followed.delete(topic);
    }
    for (const [topic, type] of wanted) if (!this.followed.has(topic)) this.followed.set(topic, this.follow(topic, type));
    if (added.length > 0) void this.fillBack(added);
  }

  private async fillBack(added: readonly PlotSeries[]): Promise<void> {
    const filling = new AbortController();
    this.fillings.add(filling);
    const targets = added.map((each) => ({ ...each, samples: this.recorded.get(each.id) }));
    // What was recorded before the first live sample came, and does not arrive as that one.
    const endS = performance.now() / 1000;
    const take = (past: RecordedSample[]) => {
      for (const { topic, path, samples } of targets) {
        const firstS = samples === undefined || samples.size === 0 ? endS : samples.timeAt(0);
        samples?.pushBefore(past.filter((each) => each.topic === topic && each.atS < firstS - travelTimeS()).map(({ atS, message }) => [atS, valueAt(message, path)] as const));
      }
    };
    await this.readPast([...new Set(added.map(({ topic }) => topic))], LONGEST_S, take, filling.signal);
    this.fillings.delete(filling);
  }

  stop(): void {
    for (const filling of this.fillings) filling.abort();
    this.fillings.clear();
    for (const end of this.followed.values()) end();
    this.followed.clear();
  }

  private follow(topic: string, type: string): () => void {
    const row = anyTopic(topic, type);
    return topics.listen(row, THROTTLE, () => {
      const sample = topics.last(row, THROTTLE);
      if (sample === undefined) return;
      for (const each of this.plotted) {
        if (each.topic === topic) this.recorded.get(each.id)?.push(sample.receivedMs / 1000, valueAt(sample.message, each.path));
      }
    });
  }
}
