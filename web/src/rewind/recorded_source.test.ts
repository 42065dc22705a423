// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import { TopicStore } from "@/ros/topics";
import { RecordedSource, needed } from "./recorded_source";
import type { Window } from "./windows";

const SCAN = { name: "/scan", type: "sensor_msgs/msg/LaserScan" } as const;
const TF = { name: "/tf", type: "tf2_msgs/msg/TFMessage" } as const;

function windowOf(fromS: number, samples: [string, number][], topics = ["/scan", "/tf"]): Window {
  const recorded = samples.map(([topic, atS]) => ({ topic, atS, message: atS }));
  return { fromS, completeS: fromS + 10, startS: 0, endS: 100, topics: new Set(topics), samples: recorded };
}

function playing() {
  const log: string[] = [];
  const source = new RecordedSource(
    new Set(["/tf"]),
    () => log.push("begins"),
    () => log.push("lacks"),
  );
  const store = new TopicStore(source, () => source.deliveringS * 1000);
  const listen = (row: typeof SCAN | typeof TF) =>
    store.listen(row, {}, () => {
      const sample = store.last(row);
      log.push(sample === undefined ? `${row.name} none` : `${row.name} ${sample.receivedMs}`);
    });
  return { log, source, store, listen };
}

const TEN: [string, number][] = [
  ["/tf", 9.5],
  ["/scan", 10],
  ["/tf", 11],
  ["/scan", 12],
  ["/scan", 13.5],
  ["/tf", 14],
  ["/scan", 14.2],
  ["/scan", 16],
];

describe("the samples that a moment needs", () => {
  it("are the last second, the last ones before it, and all of some topics", () => {
    const at = (atS: number) => needed(windowOf(10, TEN), atS, new Set(["/tf"])).map((sample) => `${sample.topic} ${sample.atS}`);
    expect(at(12.5)).toEqual(["/tf 9.5", "/tf 11", "/scan 12"]);
    expect(at(14.5)).toEqual(["/tf 9.5", "/tf 11", "/tf 14", "/scan 14.2"]);
    expect(at(14.4)).toEqual(["/tf 9.5", "/tf 11", "/scan 13.5", "/tf 14", "/scan 14.2"]);
    expect(at(9)).toEqual([]);
  });
});

describe("a recorded source", () => {
  it("delivers what follows, once, with the times of the recording", () => {
    const { log, source, listen } = playing();
    listen(SCAN);
    const window = windowOf(10, TEN);
    source.show(window, 12.5);
    source.show(window, 14.3);
    source.show(window, 14.3);
    expect(log).toEqual(["lacks", "begins", "/scan 12000", "/scan 13500", "/scan 14200"]);
  });

  it("begins anew where time goes back", () => {
    const { log, source, listen } = playing();
    listen(SCAN);
    const window = windowOf(10, TEN);
    source.show(window, 14.3);
    log.length = 0;
    source.show(window, 11);
    expect(log).toEqual(["begins", "/scan 10000"]);
  });

  it("goes on without a break into the next window", () => {
    const { log, source, listen } = playing();
    listen(SCAN);
    source.show(windowOf(10, TEN), 19.9);
    log.length = 0;
    source.show(windowOf(20, [["/scan", 19.5], ["/scan", 20.1]]), 20.2);
    expect(log).toEqual(["/scan 20100"]);
    source.show(windowOf(40, [["/scan", 39.5]]), 40);
    expect(log).toEqual(["/scan 20100", "begins", "/scan 39500"]);
  });

  it("tells a later listener what it missed, or that its topic is lacking", async () => {
    const { log, source, listen } = playing();
    listen(SCAN);
    source.show(windowOf(10, TEN, ["/scan", "/tf"]), 12.5);
    log.length = 0;
    listen(TF);
    await Promise.resolve();
    expect(log).toEqual(["/tf 9500", "/tf 11000"]);
    log.length = 0;
    source.show(windowOf(10, TEN, ["/scan"]), 13);
    listen(TF)();
    expect(log).not.toContain("lacks");
  });

  it("leaves no sample of another moment in the store", () => {
    const { source, store, listen } = playing();
    listen(SCAN);
    source.show(windowOf(10, TEN), 12.5);
    store.clear();
    expect(store.last(SCAN)).toBeUndefined();
  });
});
