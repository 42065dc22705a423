/** The last sample of every topic that something shows, with the time of its arrival. */
import type { MessageTypes } from "@/generated/messages";
import type { SubscribeOptions } from "./rosbridge";

export interface TopicRow<Type extends keyof MessageTypes = keyof MessageTypes> {
  readonly name: string;
  readonly type: Type;
}

export interface Sample<Message> {
  message: Message;
  /** performance.now() of its arrival. */
  receivedMs: number;
}

/** Where samples come from: the link to the robot, or a recording. */
export interface SampleSource {
  /** Whether samples can come now; not given by a source that is never lost. */
  readonly isOpen?: boolean;
  subscribe(topic: string, type: string, options: SubscribeOptions, deliver: (message: unknown) => void): () => void;
}

type Listener = () => void;

interface Entry {
  sample: Sample<unknown> | undefined;
  listeners: Set<Listener>;
  end: () => void;
  count: number;
}

/** One subscription per topic and throttle, whatever the number of panels that show it. */
export class TopicStore {
  private entries = new Map<string, Entry>();
  /** The last samples of topics to which nothing listens any more. */
  private kept = new Map<string, Sample<unknown>>();

  constructor(
    private readonly source: SampleSource,
    private readonly now: () => number = () => performance.now(),
  ) {}

  /** Call `listener` with every sample until the returned function is called. */
  listen(row: TopicRow, options: SubscribeOptions, listener: Listener): () => void {
    const key = entryKey(row, options);
    let entry = this.entries.get(key);
    if (entry === undefined) {
      // While the link is lost, a view that is opened shows what was received before, with its age.
      const created: Entry = { sample: this.source.isOpen === false ? this.kept.get(key) : undefined, listeners: new Set(), end: () => {}, count: 0 };
      created.end = this.source.subscribe(row.name, row.type, options, (message) => {
        created.sample = { message, receivedMs: this.now() };
        created.count += 1;
        for (const each of created.listeners) each();
      });
      this.entries.set(key, created);
      entry = created;
    }
    const current = entry;
    current.listeners.add(listener);
    return () => {
      current.listeners.delete(listener);
      if (current.listeners.size === 0 && this.entries.get(key) === current) {
        this.entries.delete(key);
        if (current.sample !== undefined) this.kept.set(key, current.sample);
        current.end();
      }
    };
  }

  /** Forget all samples, for a source that begins anew. */
  clear(): void {
    this.kept.clear();
    for (const entry of this.entries.values()) {
      entry.sample = undefined;
      for (const each of entry.listeners) each();
    }
  }

  /** The last sample, while something listens to the topic. */
  last<Type extends keyof MessageTypes>(row: TopicRow<Type>, options: SubscribeOptions = {}): Sample<MessageTypes[Type]> | undefined {
    return this.entries.get(entryKey(row, options))?.sample as Sample<MessageTypes[Type]> | undefined;
  }
}

function entryKey(row: TopicRow, options: SubscribeOptions): string {
  return `${row.name} ${row.type} ${options.throttleMs ?? 0} ${options.queueLength ?? 0}`;
}
