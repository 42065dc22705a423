// How fast the page takes in lines of the log, beside a list that is copied for every line: for bench/bench_page.py.
import { bench, describe } from "vitest";
import { LogStore, MAX_ROWS } from "@/tabs/logs/log_store";

const LINES = 10_000;
const LINES_PER_FRAME = 160; // 10 000 in a second of 60 frames
const NODES = 40;

const MESSAGES = Array.from({ length: LINES }, (_, index) => ({
  level: 20,
  name: `node_${index % NODES}`,
  msg: `line ${index}`,
  stamp: { sec: 1, nanosec: index },
  file: "a.py",
  function: "f",
  line: 3,
}));

describe("10 000 lines", () => {
  bench("log store", () => {
    const frames: (() => void)[] = [];
    const store = new LogStore((flush) => frames.push(flush));
    for (const [index, message] of MESSAGES.entries()) {
      store.add(message, index);
      if (index % LINES_PER_FRAME === 0) for (const flush of frames.splice(0)) flush();
    }
  });

  bench("list copied for every line", () => {
    let rows: readonly object[] = [];
    for (const message of MESSAGES) rows = [...rows, message].slice(-MAX_ROWS);
    if (rows.length !== MAX_ROWS) throw new Error("lines are missing");
  });
});
