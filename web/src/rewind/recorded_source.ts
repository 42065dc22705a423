/** Plays windows of the recording to whoever listens to topics, as a link to the robot would. */
import type { SampleSource } from "@/ros/topics";
import { LEAD_S, type RecordedSample, type Window } from "./windows";

interface Subscription {
  topic: string;
  deliver: (message: unknown) => void;
}

export class RecordedSource implements SampleSource {
  /** When the sample that is being delivered arrived, s of the robot's clock. */
  deliveringS = 0;
  private subscriptions = new Set<Subscription>();
  private window: Window | null = null;
  private shownS = -Infinity;

  /**
   * `begins` is called before the samples of a moment that does not follow the one before it, and `lacks` when a topic is
   * listened to of which no samples were loaded. `whole` are topics of which no sample may be left out.
   */
  constructor(
    private readonly whole: ReadonlySet<string>,
    private readonly begins: () => void,
    private readonly lacks: () => void,
  ) {}

  get topics(): string[] {
    return [...new Set([...this.subscriptions].map(({ topic }) => topic))];
  }

  subscribe(topic: string, _type: string, _options: unknown, deliver: (message: unknown) => void): () => void {
    const subscription = { topic, deliver };
    this.subscriptions.add(subscription);
    if (this.window?.topics.has(topic) === true) this.catchUp(subscription);
    else this.lacks();
    return () => this.subscriptions.delete(subscription);
  }

  /** Show a moment of a window: deliver what came since the last one, or all that the moment needs. */
  show(window: Window, atS: number): void {
    const follows = atS >= this.shownS && this.isWithin(window);
    const samples = follows ? window.samples.filter((sample) => sample.atS > this.shownS && sample.atS <= atS) : needed(window, atS, this.whole);
    this.window = window;
    this.shownS = atS;
    if (!follows) this.begins();
    for (const sample of samples) this.deliver(sample, this.subscriptions);
  }

  /** Forget what was shown. */
  close(): void {
    this.window = null;
    this.shownS = -Infinity;
  }

  /** Whether a window has all that follows the shown moment. */
  private isWithin(window: Window): boolean {
    const before = this.window;
    return before !== null && this.shownS >= window.fromS - LEAD_S && [...window.topics].every((topic) => before.topics.has(topic));
  }

  private deliver({ topic, atS, message }: RecordedSample, to: Iterable<Subscription>): void {
    this.deliveringS = atS;
    for (const each of to) if (each.topic === topic) each.deliver(message);
  }

  /** What a new listener has missed. It is told later, as by a link, once it is known to the caller. */
  private catchUp(subscription: Subscription): void {
    queueMicrotask(() => {
      if (this.window === null || !this.subscriptions.has(subscription)) return;
      for (const sample of needed(this.window, this.shownS, this.whole)) this.deliver(sample, [subscription]);
    });
  }
}

/** The samples from which a moment is seen: the last second, before that the last one of each topic, and all of `whole`. */
export function needed({ samples }: Pick<Window, "samples">, atS: number, whole: ReadonlySet<string>): RecordedSample[] {
  const past = samples.filter((sample) => sample.atS <= atS);
  const last = new Map(past.map((sample) => [sample.topic, sample]));
  return past.filter((sample) => sample.atS > atS - LEAD_S || whole.has(sample.topic) || last.get(sample.topic) === sample);
}
