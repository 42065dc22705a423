import { describe, expect, it, vi } from "vitest";
import { type LogFilter, filteredRows, rowText, rowTime } from "./log_filter";
import { LogStore, MAX_ROWS, levelOf } from "./log_store";

const ALL: LogFilter = { severity: "all", node: "", search: "" };

function storeWithFrames() {
  const frames: (() => void)[] = [];
  const store = new LogStore((flush) => frames.push(flush));
  return { store, frames, runFrame: () => frames.splice(0).forEach((flush) => flush()) };
}

const line = (level: number, name: string, msg: string) => ({ level, name, msg, stamp: { sec: 1, nanosec: 0 }, file: "a.py", function: "f", line: 3 });

describe("the tail of the log", () => {
  it("tells the page once per frame, however many lines come", () => {
    const { store, frames, runFrame } = storeWithFrames();
    const listener = vi.fn<() => void>();
    store.subscribe(listener);
    for (let index = 0; index < 10_000; index += 1) store.add(line(20, "slam", `line ${index}`), index);
    expect(frames).toHaveLength(1);
    expect(listener).not.toHaveBeenCalled();
    runFrame();
    expect(listener).toHaveBeenCalledTimes(1);
    expect(store.tail.rows).toHaveLength(MAX_ROWS);
    expect(store.tail.rows.at(-1)?.message).toBe("line 9999");
    expect(store.tail.received).toBe(10_000);
  });

  it("keeps warnings through a flood", () => {
    const { store, runFrame } = storeWithFrames();
    store.add(line(30, "nav", "a warning"), 0);
    for (let index = 0; index < 5000; index += 1) store.add(line(10, "slam", "flood"), index);
    runFrame();
    expect(filteredRows(store.tail, { ...ALL, severity: "warning" }).map(({ message }) => message)).toEqual(["a warning"]);
    expect(filteredRows(store.tail, { ...ALL, severity: "error" })).toEqual([]);
  });

  it("begins with the history, in order and each line once", () => {
    const { store, runFrame } = storeWithFrames();
    const at = (sec: number, msg = `line ${sec}`) => ({ ...line(20, "slam", msg), stamp: { sec, nanosec: 0 } });
    store.add(at(3), 0);
    store.addPast([at(1), at(2), at(3), at(4)]);
    store.add(at(4), 1);
    store.add(at(5), 2);
    runFrame();
    expect(store.tail.rows.map(({ timeS }) => timeS)).toEqual([1, 2, 3, 4, 5]);
    expect(new Set(store.tail.rows.map(({ id }) => id)).size).toBe(5);
    expect(store.tail.received).toBe(5);
    expect(filteredRows(store.tail, { ...ALL, search: "line 1" })).toHaveLength(1);
    store.clear();
    store.addPast([at(1), at(6)]);
    expect(store.tail.rows.map(({ timeS }) => timeS), "what was cleared stays away").toEqual([6]);
  });

  it("stays bounded with a long history", () => {
    const { store, runFrame } = storeWithFrames();
    store.addPast(Array.from({ length: 3 * MAX_ROWS }, (_, index) => line(30, "nav", `old ${index}`)));
    store.add({ ...line(20, "nav", "new"), stamp: { sec: 2, nanosec: 0 } }, 0);
    runFrame();
    expect(store.tail.rows).toHaveLength(MAX_ROWS);
    expect(store.tail.rows.at(-1)?.message).toBe("new");
    expect(store.tail.warnings.length).toBeLessThanOrEqual(MAX_ROWS);
  });

  it("is cleared with its counts", () => {
    const { store, runFrame } = storeWithFrames();
    store.add(line(20, "slam", "x"), 0);
    store.clear();
    runFrame();
    expect(store.tail.rows).toEqual([]);
    expect(store.tail.received).toBe(0);
  });

  it("survives empty and huge messages", () => {
    const { store, runFrame } = storeWithFrames();
    store.add({}, 0);
    store.add({ ...line(50, "x", "y".repeat(100_000)) }, 0);
    runFrame();
    expect(store.tail.rows[0]).toMatchObject({ level: "debug", node: "", message: "", place: "" });
    expect(store.tail.rows[1]?.message.length).toBeLessThan(5000);
  });
});

describe("the filter", () => {
  const { store, runFrame } = storeWithFrames();
  store.add(line(10, "slam", "Scan added"), 0);
  store.add(line(20, "nav", "Goal accepted"), 0);
  store.add(line(40, "nav", "Goal lost"), 0);
  runFrame();
  const messages = (filter: Partial<LogFilter>) => filteredRows(store.tail, { ...ALL, ...filter }).map(({ message }) => message);

  it("takes severity, node and search together", () => {
    expect(messages({})).toHaveLength(3);
    expect(messages({ severity: "info" })).toEqual(["Goal accepted", "Goal lost"]);
    expect(messages({ node: "nav", search: " LOST " })).toEqual(["Goal lost"]);
    expect(messages({ search: "slam" })).toEqual(["Scan added"]);
    expect(messages({ search: "<b>" })).toEqual([]);
  });

  it("knows levels between the named ones", () => {
    expect([0, 10, 25, 30, 45, 50, 255].map(levelOf)).toEqual(["debug", "debug", "info", "warning", "error", "fatal", "fatal"]);
  });
});

describe("a row", () => {
  it("has a time that a person reads", () => {
    expect(rowTime(75.25)).toBe("01:15.250");
    expect(rowTime(1_795_600_000.5)).toMatch(/^\d\d:\d\d:\d\d\.500$/);
  });

  it("is copied as one line", () => {
    const row = { id: 1, level: "error" as const, node: "nav", message: "Goal lost", timeS: 1, place: "a.py:3 f" };
    expect(rowText(row)).toBe("[00:01.000] [ERROR] [nav] Goal lost (a.py:3 f)");
  });
});
