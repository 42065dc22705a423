/** Why the robot cannot be moved from here now: all reasons, the nearest one first. */
import type { TextKey, TextValues } from "@/i18n/text";
import type { Role } from "@/generated/robot";

export interface DriveStatus {
  winner: string | null;
  locks: string[];
  alarms: string[];
  sink: { topic: string; listeners: number };
}

export interface DriveFacts {
  linkOpen: boolean;
  /** The page shows the past. */
  isRewound: boolean;
  /** Another tab of this browser commands. */
  isWatching: boolean;
  role: Role | null;
  holder: string | null;
  inControl: boolean;
  /** This page's own gate, with the text of its reason; null while it is open. */
  gateReason: string | null;
  /** Reasons of the robot's own e-stop; empty while it is released, and where it is not known. */
  estopReasons: string[];
  isStopKnown: boolean;
  missionDrives: boolean;
  /** The mission's state is out of date, so that it may be driving. */
  isMissionSilent: boolean;
  /** Navigation pursues a goal. */
  navigates: boolean;
  /** The drive bus's last status; null where none was received. */
  bus: DriveStatus | null;
  /** What the robot says, in the page's language. */
  inWords: (words: string) => string;
}

export interface Reason {
  key: TextKey;
  values?: TextValues;
}

/** Why the sticks would not move the robot. A mission does not keep them from it: they have the higher priority. */
export function driveObstacles(facts: DriveFacts): Reason[] {
  return motionObstacles(facts).filter(({ key }) => key !== "why_mission");
}

/**
 * What the sticks do where nothing keeps them from it. The drive bus obeys the fresh input of the highest priority: joy, then
 * manual, then auto. The manual input ends no goal and no mission: 0.5 s after its last message they drive on.
 */
export function driveAnswer({ bus, missionDrives, isMissionSilent, navigates }: DriveFacts): TextKey {
  if (bus?.winner === "joy") return "can_drive_under_joy";
  if (missionDrives || isMissionSilent) return "can_drive_over_mission";
  return navigates || bus?.winner === "auto" ? "can_drive_over_goal" : "can_drive_yes";
}

/** Why a goal, or a command to the arm, would not move the robot, or should not. */
export function motionObstacles(facts: DriveFacts): Reason[] {
  if (!facts.linkOpen) return [{ key: "why_no_link" }];
  const reasons: Reason[] = [];
  if (facts.isRewound) reasons.push({ key: "why_rewound" });
  if (facts.isWatching) reasons.push({ key: "why_other_tab" });
  if (facts.role === "viewer") reasons.push({ key: "why_viewer" });
  if (facts.estopReasons.length > 0) reasons.push({ key: "why_estop", values: { reason: facts.estopReasons.join(", ") } });
  if (!facts.isStopKnown) reasons.push({ key: "why_stop_unknown" });
  if (!facts.inControl && facts.holder !== null) reasons.push({ key: "why_control", values: { holder: facts.holder } });
  if (facts.gateReason !== null) reasons.push({ key: facts.estopReasons.length > 0 ? "why_gate" : "why_hold_first", values: { reason: facts.gateReason } });
  if (facts.missionDrives) reasons.push({ key: "why_mission" });
  if (facts.bus === null) reasons.push({ key: "why_no_bus" });
  else {
    const locks = facts.estopReasons.length > 0 ? facts.bus.locks.filter((lock) => !lock.includes("e-stop")) : facts.bus.locks;
    if (locks.length > 0) reasons.push({ key: "why_locked", values: { reason: locks.map(facts.inWords).join(", ") } });
    if (facts.bus.sink.listeners === 0) reasons.push({ key: "why_no_wheels" });
  }
  return reasons;
}

const AGAINST_RELOCATION: readonly TextKey[] = ["why_no_link", "why_rewound", "why_other_tab", "why_viewer", "why_control", "why_mission"];

/** Why the robot cannot be told that it is elsewhere on the map: it may be stopped, but no mission must be driving by the map. */
export function relocationObstacles(facts: DriveFacts): Reason[] {
  return motionObstacles(facts).filter(({ key }) => AGAINST_RELOCATION.includes(key));
}

/** The JSON of `/lupin/drive/status`; null where it is damaged. */
export function parseDriveStatus(text: string): DriveStatus | null {
  const object = parseObject(text);
  if (object === null) return null;
  const sink = object["sink"] as Partial<DriveStatus["sink"]> | undefined;
  return {
    winner: typeof object["winner"] === "string" ? object["winner"] : null,
    locks: strings(object["locks"]),
    alarms: strings(object["alarms"]),
    sink: { topic: String(sink?.topic ?? ""), listeners: Number(sink?.listeners ?? 0) },
  };
}

/** The reasons in the JSON of `/lupin/estop/status`. */
export function parseEstopReasons(text: string): { engaged: boolean; reasons: string[]; warnings: string[] } | null {
  const object = parseObject(text);
  if (object === null) return null;
  return { engaged: object["engaged"] === true, reasons: strings(object["reasons"]), warnings: strings(object["warnings"]) };
}

function parseObject(text: string): Record<string, unknown> | null {
  try {
    const value: unknown = JSON.parse(text);
    return typeof value === "object" && value !== null && !Array.isArray(value) ? (value as Record<string, unknown>) : null;
  } catch {
    return null;
  }
}

function strings(value: unknown): string[] {
  return Array.isArray(value) ? value.filter((each): each is string => typeof each === "string") : [];
}
