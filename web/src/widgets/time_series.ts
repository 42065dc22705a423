/** Numbers over time in a ring of fixed size, for sparklines and plots: memory stays the same however long a page is open. */

type Listener = () => void;

export class TimeSeries {
  private readonly times: Float64Array;
  private readonly values: Float64Array;
  private start = 0;
  private count = 0;
  private readonly listeners = new Set<Listener>();

  /** Keeps what is no older than `windowS`, and the newest `capacity` of it. */
  constructor(
    readonly windowS: number,
    readonly capacity: number,
  ) {
    this.times = new Float64Array(capacity);
    this.values = new Float64Array(capacity);
  }

  get size(): number {
    return this.count;
  }

  /** Add a value; times must not fall. A time that is not later than the last one is ignored. */
  push(timeS: number, value: number): void {
    if (!this.store(timeS, value)) return;
    for (const listener of this.listeners) listener();
  }

  private store(timeS: number, value: number): boolean {
    if (this.count > 0 && timeS <= this.timeAt(this.count - 1)) return false;
    if (this.count === this.capacity) this.drop();
    const place = (this.start + this.count) % this.capacity;
    this.times[place] = timeS;
    this.values[place] = value;
    this.count += 1;
    while (this.count > 1 && this.timeAt(0) < timeS - this.windowS) this.drop();
    return true;
  }

  /** Put samples before the first one, in the order of their times. What is not earlier than it is left out, and the newest are kept. */
  pushBefore(samples: readonly (readonly [timeS: number, value: number])[]): void {
    const first = this.count === 0 ? Infinity : this.timeAt(0);
    const here = Array.from({ length: this.count }, (_, index) => [this.timeAt(index), this.valueAt(index)] as const);
    this.start = this.count = 0;
    for (const [timeS, value] of [...samples.filter(([atS]) => atS < first), ...here]) this.store(timeS, value);
    for (const listener of this.listeners) listener();
  }

  /** The time of the sample `index`, 0 for the oldest. */
  timeAt(index: number): number {
    return this.times[(this.start + index) % this.capacity] ?? NaN;
  }

  valueAt(index: number): number {
    return this.values[(this.start + index) % this.capacity] ?? NaN;
  }

  get lastTime(): number {
    return this.count === 0 ? NaN : this.timeAt(this.count - 1);
  }

  get lastValue(): number {
    return this.count === 0 ? NaN : this.valueAt(this.count - 1);
  }

  clear(): void {
    this.start = this.count = 0;
    for (const listener of this.listeners) listener();
  }

  /** A copy that does not change any more. */
  copy(): TimeSeries {
    const copied = new TimeSeries(this.windowS, this.capacity);
    for (let index = 0; index < this.count; index += 1) copied.push(this.timeAt(index), this.valueAt(index));
    return copied;
  }

  /** Call `listener` after every change, until the returned function is called. */
  listen(listener: Listener): () => void {
    this.listeners.add(listener);
    return () => void this.listeners.delete(listener);
  }

  private drop(): void {
    this.start = (this.start + 1) % this.capacity;
    this.count -= 1;
  }
}

/** Silence this much longer than usual is a gap in a line. */
const GAP_PERIODS = 6;
const GAP_S = 2.5;

export interface Buckets {
  times: number[];
  /** Null breaks the line; undefined stands for no sample here, over which the line goes on. */
  values: (number | null | undefined)[];
}

/**
 * A series between two times on a grid of `count` buckets. Each has two places, for its smallest and largest value in the order
 * in which they came: a peak is never lost, however many samples there are. Series on the same grid can be drawn together.
 */
export function bucketize(series: TimeSeries, fromS: number, toS: number, count: number): Buckets {
  const step = (toS - fromS) / count;
  const times = Array.from({ length: 2 * count }, (_, index) => fromS + (index / 2 + 0.25) * step);
  const values = Array.from<number | null | undefined>({ length: 2 * count });
  const gapS = Math.max(GAP_S, GAP_PERIODS * typicalPeriod(series));
  let beforeS = NaN;
  let index = firstAtOrAfter(series, fromS);
  while (index < series.size) {
    const bucket = Math.floor((series.timeAt(index) - fromS) / step);
    if (bucket >= count) break;
    let [low, high] = [index, index];
    let next = index;
    let broken = false;
    while (next < series.size && Math.floor((series.timeAt(next) - fromS) / step) === bucket) {
      const value = series.valueAt(next);
      if (!Number.isFinite(value)) broken = true;
      if (!(series.valueAt(low) <= value)) low = next;
      if (!(series.valueAt(high) >= value)) high = next;
      next += 1;
    }
    const [first, second] = low < high ? [low, high] : [high, low];
    const place = 2 * bucket;
    values[place] = orGap(series.valueAt(first));
    values[place + 1] = low === high && !broken ? undefined : orGap(series.valueAt(second));
    if (series.timeAt(index) - beforeS > gapS && place > 0) values[place - 1] = null;
    beforeS = series.timeAt(next - 1);
    index = next;
  }
  return { times, values };
}

/** The window that ends at `toS`, on a grid that does not move with time, so that a moving line does not shimmer. */
export function alignedWindow(toS: number, windowS: number, count: number): { fromS: number; toS: number } {
  const step = windowS / count;
  const end = Math.ceil((toS + 1e-9) / step) * step;
  return { fromS: end - windowS, toS: end };
}

function orGap(value: number): number | null {
  return Number.isFinite(value) ? value : null;
}

function typicalPeriod(series: TimeSeries): number {
  const last = series.size - 1;
  const from = Math.max(0, last - 20);
  return last > from ? (series.timeAt(last) - series.timeAt(from)) / (last - from) : 0;
}

function firstAtOrAfter(series: TimeSeries, timeS: number): number {
  let [low, high] = [0, series.size];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (series.timeAt(middle) < timeS) low = middle + 1;
    else high = middle;
  }
  return low;
}
