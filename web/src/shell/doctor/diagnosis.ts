/** Summarizes a diagnosis in one sentence and in numbers. */
import type { DoctorState, Finding } from "@/api/console_store";
import type { TextKey } from "@/i18n/text";

/** The exit status of `lupin doctor`, which is part of its JSON. */
const UNREACHABLE = 3;
const INCOMPLETE = 4;

export type Verdict = "unknown" | "healthy" | "warnings" | "problems" | "unreachable" | "incomplete";

export function verdictOf({ diagnosis }: DoctorState): Verdict {
  if (diagnosis === null) return "unknown";
  if (diagnosis.status === UNREACHABLE) return "unreachable";
  if (diagnosis.findings.some(isProblem)) return "problems";
  if (diagnosis.findings.length > 0) return "warnings";
  return diagnosis.status === INCOMPLETE || diagnosis.unknown.length > 0 || diagnosis.broken.length > 0 ? "incomplete" : "healthy";
}

export const VERDICTS: Readonly<Record<Verdict, TextKey>> = {
  unknown: "doctor_not_asked",
  healthy: "doctor_can_work",
  warnings: "doctor_can_work",
  problems: "doctor_cannot_work",
  unreachable: "doctor_unreachable",
  incomplete: "doctor_incomplete",
};

export function isProblem(finding: Finding): boolean {
  return finding.severity === "problem";
}

export interface Counts {
  problems: number;
  warnings: number;
  checks: number;
}

export function countsOf({ diagnosis }: DoctorState): Counts {
  const findings = diagnosis?.findings ?? [];
  const problems = findings.filter(isProblem).length;
  return { problems, warnings: findings.length - problems, checks: diagnosis?.checks.length ?? 0 };
}

/** A step of a playbook, as `lupin play --json` prints it. */
export interface PlayStep {
  name: string;
  machine: string;
  state: string;
  summary: string;
  diff: string;
  error: string;
}

export interface PlayResult {
  playbook: string;
  robot: string;
  state: string;
  steps: PlayStep[];
  dry_run: boolean;
  message: string;
  next_command: string;
}

/** How many steps of a play changed something, or would. */
export function changesOf(result: PlayResult): number {
  return result.steps.filter(({ state }) => state === "changed" || state === "would-change").length;
}
