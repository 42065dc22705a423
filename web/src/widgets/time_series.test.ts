import { describe, expect, it, vi } from "vitest";
import { TimeSeries, bucketize } from "./time_series";

function series(pairs: readonly (readonly [number, number])[], windowS = 300, capacity = 1000): TimeSeries {
  const made = new TimeSeries(windowS, capacity);
  for (const [time, value] of pairs) made.push(time, value);
  return made;
}

const every = (stepS: number, count: number, value = (time: number) => time) =>
  Array.from({ length: count }, (_, index) => [index * stepS, value(index * stepS)] as const);

describe("a time series", () => {
  it("keeps its window and its capacity", () => {
    const five = series(every(1, 20), 5);
    expect([five.size, five.timeAt(0), five.lastTime]).toEqual([6, 14, 19]);
    const three = series(every(1, 20), 300, 3);
    expect([three.size, three.timeAt(0), three.lastValue]).toEqual([3, 17, 19]);
  });

  it("passes over times that do not rise", () => {
    expect(series([[1, 1], [1, 2], [0, 3]]).size).toBe(1);
  });

  it("takes earlier samples in, within its bounds", () => {
    const made = series([[5, 5], [6, 6]], 300, 4);
    made.pushBefore([[1, 1], [3, 3], [4, 4], [5, 50], [7, 7]]);
    expect(Array.from({ length: made.size }, (_, index) => made.timeAt(index))).toEqual([3, 4, 5, 6]);
    expect(made.valueAt(2)).toBe(5);
    made.push(7, 7);
    expect([made.size, made.lastTime]).toEqual([4, 7]);
    const empty = series([]);
    empty.pushBefore([[1, 1], [2, 2]]);
    expect([empty.size, empty.lastTime]).toEqual([2, 2]);
  });

  it("tells its listeners, and copies itself", () => {
    const made = series(every(1, 3));
    const listener = vi.fn<() => void>();
    const end = made.listen(listener);
    const copied = made.copy();
    made.push(9, 9);
    end();
    made.clear();
    expect(listener).toHaveBeenCalledTimes(1);
    expect([copied.size, copied.lastValue, made.size]).toEqual([3, 2, 0]);
    expect(made.lastTime).toBeNaN();
  });
});

describe("buckets", () => {
  it("keep every peak", () => {
    const spike = series(every(0.01, 1000, (time) => (Math.abs(time - 5) < 0.005 ? 99 : Math.abs(time - 7) < 0.005 ? -99 : 0)));
    const { values } = bucketize(spike, 0, 10, 20);
    expect(values).toHaveLength(40);
    expect(values).toContain(99);
    expect(values).toContain(-99);
  });

  it("break the line where there was silence, not between slow samples", () => {
    const slow = bucketize(series(every(1, 10)), 0, 10, 100).values;
    expect(slow.filter((value) => value === null)).toHaveLength(0);
    const silent = bucketize(series([...every(0.1, 10), ...every(0.1, 10).map(([time, value]) => [time + 9, value] as const)]), 0, 10, 100);
    expect(silent.values.filter((value) => value === null)).toHaveLength(1);
  });

  it("break the line at what is not a number", () => {
    const { values } = bucketize(series([[0, 1], [1, NaN], [2, 3]]), 0, 3, 3);
    expect(values[0]).toBe(1);
    expect(values[2]).toBeNull();
    expect(values[4]).toBe(3);
  });

  it("are empty without samples", () => {
    expect(bucketize(series([]), 0, 10, 5).values.every((value) => value === undefined)).toBe(true);
  });
});
