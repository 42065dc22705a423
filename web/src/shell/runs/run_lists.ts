/** The stored runs and the journal of playbooks, as the server lists them. */
import { fixed } from "@/ui/numbers";

export interface StoredRun {
  id: string;
  state: string;
  sizeBytes: number;
  kept: boolean;
  startedS: number | null;
}

/** The rows of `/_api/runs`; what is malformed is left out. */
export function parseRuns(value: unknown): StoredRun[] {
  return rows(value).flatMap(({ id, state, size_bytes, kept, started_s }): StoredRun[] => {
    if (typeof id !== "string" || id === "") return [];
    return [{ id, state: text(state), sizeBytes: number(size_bytes) ?? 0, kept: kept === true, startedS: number(started_s) }];
  });
}

export interface Play {
  run: string;
  playbook: string;
  robot: string;
  state: string;
  started: Date | null;
  /** The command that continues it; empty if it needs none. */
  resume: string;
}

/** The rows of `/_api/plays` and `/_api/deployments`. */
export function parsePlays(value: unknown): Play[] {
  return rows(value).flatMap(({ run, playbook, robot, state, started, resume }): Play[] => {
    if (typeof run !== "string" || run === "") return [];
    const date = typeof started === "string" ? new Date(started) : null;
    return [
      {
        run,
        playbook: text(playbook),
        robot: text(robot),
        state: text(state),
        started: date === null || Number.isNaN(date.getTime()) ? null : date,
        resume: text(resume),
      },
    ];
  });
}

/** Whether a run has ended well, so that it needs no attention. */
export function endedWell(state: string): boolean {
  return state === "up" || state === "DONE" || state === "done";
}

export function megabytes(bytes: number): string {
  return fixed(bytes / 1e6, bytes < 10e6 ? 1 : 0);
}

export function reportPath(run: string): string {
  return `/_api/runs/${encodeURIComponent(run)}/report/report.html`;
}

function rows(value: unknown): Record<string, unknown>[] {
  return Array.isArray(value) ? value.filter((row): row is Record<string, unknown> => typeof row === "object" && row !== null) : [];
}

function text(value: unknown): string {
  return typeof value === "string" ? value : "";
}

function number(value: unknown): number | null {
  return typeof value === "number" && Number.isFinite(value) ? value : null;
}
