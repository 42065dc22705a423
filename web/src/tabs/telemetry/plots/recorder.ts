/** Records the plotted fields while the plots are open. */
import { topics } from "@/robot";
import type { TopicRow } from "@/ros/topics";
import { TimeSeries } from "@/widgets/time_series";
import { valueAt } from "../fields";
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

  /** The samples of a series; null before it is recorded. */
  samples(id: string): TimeSeries | null {
    return this.recorded.get(id) ?? null;
  }

  /** Record these series and no others. */
  record(plotted: readonly PlotSeries[]): void {
    this.plotted = plotted;
    for (const id of this.recorded.keys()) if (!plotted.some((each) => each.id === id)) this.recorded.delete(id);
    for (const { id } of plotted) if (!this.recorded.has(id)) this.recorded.set(id, new TimeSeries(LONGEST_S, CAPACITY));
    const wanted = new Map(plotted.map(({ topic, type }) => [topic, type]));
    for (const [topic, end] of this.followed) {
      if (wanted.has(topic)) continue;
      end();
      this.followed.delete(topic);
    }
    for (const [topic, type] of wanted) if (!this.followed.has(topic)) this.followed.set(topic, this.follow(topic, type));
  }

  stop(): void {
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
