// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import { logLines, parseJournal, parseNames, parseRuns } from "./run_files";

describe("the files of a run", () => {
  it("are listed, whatever the server sends", () => {
    expect(parseRuns([{ id: "a", state: "up", started_s: 3 }, { state: "x" }, 7, null])).toEqual([{ id: "a", state: "up", startedS: 3 }]);
    expect(parseNames(["slam", 7])).toEqual(["slam"]);
    for (const answer of [null, {}, "x"]) expect([parseRuns(answer), parseNames(answer), parseJournal(answer)]).toEqual([[], [], []]);
  });

  it("hold the journal, newest first", () => {
    const rows = parseJournal([
      { time: "2030-01-02T03:04:05.000+00:00", session: "laptop", what: "call /mission/start", detail: "{}" },
      { time: "never", session: "phone", what: "release", refused: "laptop has control", repeats: 3 },
    ]);
    expect(rows.map(({ session }) => session)).toEqual(["phone", "laptop"]);
    expect(rows[0]).toMatchObject({ timeMs: NaN, detail: "", refused: "laptop has control", repeats: 3 });
    expect(rows[1]?.timeMs).toBe(Date.UTC(2030, 0, 2, 3, 4, 5));
  });
});

describe("the lines of a log file", () => {
  it("lose the colors of a terminal and keep their tone", () => {
    const escape = String.fromCharCode(27);
    expect(logLines(`${escape}[33m[WARN] [1.5] [slam]: late${escape}[0m\r\n[INFO] fine\nValueError: bad\n`)).toEqual([
      { number: 1, text: "[WARN] [1.5] [slam]: late", tone: "warning" },
      { number: 2, text: "[INFO] fine", tone: "plain" },
      { number: 3, text: "ValueError: bad", tone: "error" },
    ]);
  });

  it("are none in an empty file", () => {
    expect(logLines("")).toEqual([]);
  });
});
