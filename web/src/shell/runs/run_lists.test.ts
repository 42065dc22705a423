import { describe, expect, it } from "vitest";
import { endedWell, megabytes, parsePlays, parseRuns, reportPath } from "./run_lists";

describe("the lists of runs and playbooks", () => {
  it("are read, and what is malformed is left out", () => {
    expect(parseRuns([{ id: "a", state: "DONE", size_bytes: 5, kept: true, started_s: 1.5 }, { state: "up" }, null, { id: "b" }])).toEqual([
      { id: "a", state: "DONE", sizeBytes: 5, kept: true, startedS: 1.5 },
      { id: "b", state: "", sizeBytes: 0, kept: false, startedS: null },
    ]);
    expect(parseRuns({ error: "no" })).toEqual([]);
    const [play, other] = parsePlays([
      { run: "r", playbook: "heal", robot: "g", state: "failed", started: "2026-11-24T06:44:10+00:00", resume: "lupin play heal --resume" },
      { run: "s", started: "some day" },
    ]);
    expect(play).toMatchObject({ playbook: "heal", resume: "lupin play heal --resume" });
    expect(play?.started?.toISOString()).toBe("2026-11-24T06:44:10.000Z");
    expect(other?.started).toBeNull();
  });

  it("name states, sizes and addresses", () => {
    expect([endedWell("DONE"), endedWell("up"), endedWell("FAULT"), endedWell("interrupted"), endedWell("NO_RESULT")]).toEqual([true, true, false, false, false]);
    expect([megabytes(2_340_000), megabytes(214_000_000)]).toEqual(["2.3", "214"]);
    expect(reportPath("a/b")).toBe("/_api/runs/a%2Fb/report/report.html");
  });
});
