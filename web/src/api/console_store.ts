/** What the console's server says: who this browser is, who has control, why the robot is stopped, the run, the doctor. */
import { create } from "zustand";
import type { Role } from "@/generated/robot";
import type { Settings } from "@/generated/settings";

export interface Own {
  name: string;
  role: Role;
}

export interface Control {
  holder: string | null;
  since_s: number | null;
  requester: string | null;
}

export interface ProcessState {
  name: string;
  phase: string;
  /** Why the process is silent or being replaced; empty while it works. */
  trouble: string;
  why: string;
  waiting_for?: string[];
  waiting_s?: number | null;
  restarts?: number;
  cpu_percent?: number;
  memory_mb?: number;
}

export interface RunState {
  id?: string;
  age_s?: number;
  ready_s?: number | null;
  stages?: ProcessState[];
  alarms?: string[];
  rates_hz?: Record<string, number>;
  silent_s?: Record<string, number>;
}

export interface Fix {
  command: string;
  playbook: string | null;
  safe: boolean;
  variables: Record<string, string>;
}

export interface Finding {
  id: string;
  severity: string;
  where: string;
  symptom: string;
  cause: string;
  evidence: string[];
  fix: Fix;
  consequences?: Finding[];
}

export interface Diagnosis {
  status: number;
  findings: Finding[];
  unknown: unknown[];
  broken: unknown[];
  checks: string[];
}

export interface DoctorState {
  busy: string;
  diagnosis: Diagnosis | null;
  examined_s: number | null;
  problem: string;
}

export interface Location {
  x: number;
  y: number;
  yaw: number;
}

export interface ConsoleState {
  own: Own | null;
  /** Whether the first answer about this browser has come. */
  known: boolean;
  control: Control;
  stop: string[];
  run: RunState;
  doctor: DoctorState;
  locations: Record<string, Location>;
  settings: Partial<Settings>;
  /** Whether the channel of events is open, and since when (performance.now()). */
  online: boolean;
  changedMs: number;
}

export const useConsole = create<ConsoleState>(() => ({
  own: null,
  known: false,
  control: { holder: null, since_s: null, requester: null },
  stop: [],
  run: {},
  doctor: { busy: "", diagnosis: null, examined_s: null, problem: "" },
  locations: {},
  settings: {},
  online: false,
  changedMs: 0,
}));

export function hasControl(state: ConsoleState): boolean {
  return state.own !== null && state.control.holder === state.own.name;
}
