import { describe, expect, it } from "vitest";
import type { Diagnosis, DoctorState, Finding } from "@/api/console_store";
import { changesOf, countsOf, verdictOf } from "./diagnosis";

const FIX = { instruction: "", command: "", playbook: null, safe: false, variables: {} };
const finding = (severity: string): Finding => ({ id: "x", severity, where: "robot", symptom: "", cause: "", evidence: [], fix: FIX });
const state = (diagnosis: Partial<Diagnosis> | null): DoctorState => ({
  busy: "",
  problem: "",
  examined_s: null,
  diagnosis: diagnosis === null ? null : { status: 0, findings: [], unknown: [], broken: [], checks: [], ...diagnosis },
});

describe("the doctor's verdict", () => {
  it("names the worst that is known", () => {
    expect(verdictOf(state(null))).toBe("unknown");
    expect(verdictOf(state({}))).toBe("healthy");
    expect(verdictOf(state({ status: 1, findings: [finding("warning")] }))).toBe("warnings");
    expect(verdictOf(state({ status: 1, findings: [finding("warning"), finding("problem")] }))).toBe("problems");
    expect(verdictOf(state({ status: 3, findings: [finding("problem")] }))).toBe("unreachable");
  });

  it("never calls healthy what was not examined", () => {
    expect(verdictOf(state({ status: 4, unknown: ["robot: clock: the probe timed out"] }))).toBe("incomplete");
    expect(verdictOf(state({ broken: ["ports: ValueError: no number"] }))).toBe("incomplete");
  });

  it("counts", () => {
    const counted = countsOf(state({ findings: [finding("problem"), finding("warning"), finding("warning")], checks: ["a", "b"] }));
    expect(counted).toEqual({ problems: 1, warnings: 2, checks: 2 });
    const step = (now: string) => ({ name: "", machine: "", state: now, summary: "", diff: "", error: "" });
    const result = { playbook: "", robot: "", state: "done", dry_run: true, message: "", next_command: "", steps: [step("same"), step("would-change"), step("changed")] };
    expect(changesOf(result)).toBe(2);
  });
});
