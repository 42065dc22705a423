/** The arm's library: stored poses and sequences, and what is recorded or replayed now. */

export interface StoredPose {
  name: string;
  note: string;
  hasGripper: boolean;
}

export type RecordMode = "teleop" | "kinesthetic";

export interface StoredSequence {
  name: string;
  mode: string;
  durationS: number;
  waypoints: number;
  hasGripper: boolean;
}

export interface Library {
  poses: StoredPose[];
  sequences: StoredSequence[];
}

export interface LibraryState {
  recording: boolean;
  playing: boolean;
  name: string;
  mode: string;
  /** Elapsed fraction of the replay, 0 to 1. */
  progress: number;
  elapsedS: number;
  waypoints: number;
  /** False while the arm is limp. */
  torque: boolean;
  /** Why the last replay was aborted; empty if it was not. */
  aborted: string;
}

export const SPEEDS = { low: 0.25, high: 2, step: 0.25 } as const;
export const MAX_NAME_LENGTH = 32;

/** The library in the answer of the list service; null if it is malformed. */
export function parseLibrary(json: string): Library | null {
  const object = parsed(json);
  if (object === null) return null;
  return {
    poses: rows(object["poses"]).map((row) => ({ name: row.name, note: text(row["note"]), hasGripper: row["has_gripper"] === true })),
    sequences: rows(object["sequences"]).map((row) => ({
      name: row.name,
      mode: text(row["mode"]),
      durationS: number(row["duration_s"]),
      waypoints: number(row["n_waypoints"]),
      hasGripper: row["include_gripper"] === true,
    })),
  };
}

export function parseLibraryState(json: string): LibraryState | null {
  const object = parsed(json);
  if (object === null) return null;
  return {
    recording: object["recording"] === true,
    playing: object["playing"] === true,
    name: text(object["name"]),
    mode: text(object["mode"]),
    progress: Math.min(1, Math.max(0, number(object["progress"]))),
    elapsedS: number(object["elapsed_s"]),
    waypoints: number(object["n_waypoints"]),
    torque: object["torque"] !== false,
    aborted: text(object["aborted"]),
  };
}

/**
 * Whether the library moves the arm, or holds it limp, so that sliders would fight it. A recording in teleop mode does neither:
 * it records what the sliders do.
 */
export function isArmBusy(state: LibraryState | null): boolean {
  return state !== null && (state.playing || (state.recording && state.mode === "kinesthetic"));
}

/** A name as the library stores it; null if the library would refuse it. */
export function storedName(name: string): string | null {
  const stored = name.trim().toLowerCase();
  return stored.length <= MAX_NAME_LENGTH && /^[a-z0-9][a-z0-9_-]*$/.test(stored) ? stored : null;
}

type Row = Record<string, unknown> & { name: string };

function rows(value: unknown): Row[] {
  if (!Array.isArray(value)) return [];
  return value.filter((each): each is Row => typeof each === "object" && each !== null && typeof (each as Row).name === "string");
}

function parsed(json: string): Record<string, unknown> | null {
  try {
    const value: unknown = JSON.parse(json);
    return typeof value === "object" && value !== null && !Array.isArray(value) ? (value as Record<string, unknown>) : null;
  } catch {
    return null;
  }
}

function text(value: unknown): string {
  return typeof value === "string" ? value : "";
}

function number(value: unknown): number {
  return typeof value === "number" && Number.isFinite(value) ? value : 0;
}
