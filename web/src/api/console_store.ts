/** The state of the console's server: who this browser is, who has control, why the robot is stopped, the run, the doctor. */
import { create } from "zustand";
import type { Role } from "@/generated/robot";
import type { Settings } from "@/generated/settings";

/** A paired browser. */
export interface Session {
  name: string;
  role: Role;
}

export interface Control {
  holder: string | null;
  /** When the holder got control, seconds since 1970. */
  since_s: number | null;
  requester: string | null;
  /** How long its holder has left to answer the requester, s. */
  answer_within_s?: number | null;
}

/** A change of a stop or of control, which the server has decided and keeps. */
export interface ConsoleEvent {
  /** Rises with every event of the run. */
  number: number;
  /** The robot's time, s. */
  robot_s: number;
  kind: string;
  /** The session that acted or was lost. */
  name: string;
  /** Another one that it concerns; empty if there is none. */
  other: string;
}

/** What stops the robot. */
export interface StopHold {
  /** How it came about: by a console, or `robot` where the e-stop itself gives the reason. */
  kind: "pressed" | "left" | "lost_driving" | "lost_holding" | "lost_in_control" | "not_back" | "silent" | "robot";
  /** In the server's words. */
  text: string;
  /** Its name, by which it is released; null for `robot`, as are the following. */
  press: string | null;
  /** The session whose it is. */
  name: string | null;
  age_s: number | null;
}

export interface ProcessState {
  name: string;
  phase: string;
  /** Why the process is silent or being replaced; empty while it works. */
  trouble: string;
  /** Why the process is in its phase, such as the status with which it exited; empty while it works. */
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
  /** Seconds from the start of the run until it was ready; null while it starts. */
  ready_s?: number | null;
  /** The processes of the run. */
  stages?: ProcessState[];
  alarms?: string[];
  rates_hz?: Record<string, number>;
  silent_s?: Record<string, number>;
}

export interface Fix {
  /** What a person does by hand, or must know before typing the command; may be empty. */
  instruction: string;
  /** A line for a shell of the laptop; empty if there is only something to do by hand. */
  command: string;
  playbook: string | null;
  /** Whether the playbook stops nothing that works and loses no data. */
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
  /** The exit status of `lupin doctor`. */
  status: number;
  findings: Finding[];
  /** A line for each fact that has no value, so that checks are undecided. */
  unknown: string[];
  /** A line for each check or plug-in that failed. */
  broken: string[];
  checks: string[];
}

export interface DoctorState {
  /** What the doctor is doing, such as "examining"; empty while it does nothing. */
  busy: string;
  diagnosis: Diagnosis | null;
  /** When the diagnosis was made, seconds since 1970. */
  examined_s: number | null;
  /** Why the doctor itself failed; empty if it did not. */
  problem: string;
}

export interface Location {
  x: number;
  y: number;
  yaw: number;
}

/** Where the robot shall stand to read a tag, as in the file of overrides; what is missing is computed. */
export interface Approach {
  goal_x?: number;
  goal_y?: number;
  yaw?: number;
  standoff?: number;
}

export interface ConsoleState {
  /** This browser's session; null if it is not paired. */
  session: Session | null;
  /** Whether the server has said what `session` is; until then, null means nothing. */
  sessionLoaded: boolean;
  control: Control;
  /** Everybody who is connected now, this browser too. */
  browsers: Session[];
  /** What stops the robot; empty while nothing does. Named like the server's event. */
  stop: StopHold[];
  /** When each of them was first shown here (performance.now()), by its press. */
  stopShownMs: Readonly<Record<string, number>>;
  run: RunState;
  doctor: DoctorState;
  locations: Record<string, Location>;
  /** By tag. */
  approaches: Record<string, Approach>;
  settings: Partial<Settings>;
  /** The server's version of the page when this one was opened; empty if it has none. */
  pageVersion: string;
  /** Whether the server has another version by now. */
  isOutdated: boolean;
  /** Whether the event channel is open, and something was received on it. */
  online: boolean;
  /** When `online` last changed (performance.now()). */
  onlineChangedMs: number;
}

export const useConsole = create<ConsoleState>(() => ({
  session: null,
  sessionLoaded: false,
  control: { holder: null, since_s: null, requester: null },
  browsers: [],
  stop: [],
  stopShownMs: {},
  run: {},
  doctor: { busy: "", diagnosis: null, examined_s: null, problem: "" },
  locations: {},
  approaches: {},
  settings: {},
  pageVersion: "",
  isOutdated: false,
  online: false,
  onlineChangedMs: 0,
}));

/** Show what stops the robot. */
export function showStops(stop: StopHold[]): void {
  const nowMs = performance.now();
  useConsole.setState(({ stopShownMs }) => ({
    stop,
    stopShownMs: Object.fromEntries(stop.flatMap(({ press }) => (press === null ? [] : [[press, stopShownMs[press] ?? nowMs]]))),
  }));
}

/** Note whether the event channel works. An attempt that fails does not restart the age of the loss. */
export function setOnline(online: boolean): void {
  useConsole.setState((before) => (before.online === online ? before : { online, onlineChangedMs: performance.now() }));
}

/** Everybody who is connected but this browser. */
export function otherBrowsers({ browsers, session }: ConsoleState): Session[] {
  return browsers.filter(({ name }) => name !== session?.name);
}

export function hasControl(state: ConsoleState): boolean {
  return state.session?.role === "operator" && state.control.holder === state.session.name;
}
