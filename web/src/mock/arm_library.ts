/** Mock of the arm's library of poses and sequences, with its recorder and player. */
import { Refused, type MockArm } from "./arm";

/** Waypoints per second of a recording. */
const SAMPLE_HZ = 12;
const OVERWRITE = "choose another name or overwrite it";
const NAME = /^[a-z0-9][a-z0-9_-]{0,31}$/;

interface Pose {
  arm: number[];
  gripper: number | null;
  note: string;
}

interface Sequence {
  mode: string;
  includeGripper: boolean;
  durationS: number;
  waypoints: number;
}

interface Activity {
  kind: "recording" | "playing";
  name: string;
  mode: string;
  includeGripper: boolean;
  beganS: number;
  durationS: number;
}

export class MockArmLibrary {
  private poses = new Map<string, Pose>([
    ["look_left", { arm: [0.7, 0.3, -0.5, -1.1], gripper: null, note: "" }],
    ["over_pot", { arm: [0, -0.45, 0.85, -0.7], gripper: -0.2, note: "before a pick" }],
  ]);
  private sequences = new Map<string, Sequence>([
    ["wave", { mode: "teleop", includeGripper: true, durationS: 8.4, waypoints: 96 }],
    ["check_row", { mode: "kinesthetic", includeGripper: false, durationS: 21, waypoints: 240 }],
  ]);
  private activity: Activity | null = null;
  private nowS = 0;

  constructor(private readonly arm: MockArm) {}

  listing(): string {
    const byName = <Value>(map: Map<string, Value>) => [...map].toSorted(([a], [b]) => a.localeCompare(b));
    return JSON.stringify({
      poses: byName(this.poses).map(([name, pose]) => ({ name, note: pose.note, has_gripper: pose.gripper !== null })),
      sequences: byName(this.sequences).map(([name, each]) => ({
        name,
        mode: each.mode,
        duration_s: each.durationS,
        n_waypoints: each.waypoints,
        include_gripper: each.includeGripper,
      })),
    });
  }

  state(): string {
    const { activity } = this;
    const elapsed = activity === null ? 0 : this.nowS - activity.beganS;
    return JSON.stringify({
      recording: activity?.kind === "recording",
      playing: activity?.kind === "playing",
      name: activity?.name ?? "",
      mode: activity?.mode ?? "",
      progress: activity?.kind === "playing" ? round(Math.min(1, elapsed / activity.durationS), 3) : 0,
      elapsed_s: round(elapsed, 2),
      n_waypoints: activity?.kind === "recording" ? Math.floor(elapsed * SAMPLE_HZ) : 0,
      torque: this.arm.torque,
      aborted: "",
    });
  }

  advance(nowS: number): void {
    this.nowS = nowS;
    if (this.activity?.kind === "playing" && nowS - this.activity.beganS >= this.activity.durationS) this.activity = null;
  }

  savePose(name: string, pose: Pose, overwrite: boolean): string {
    const valid = validName(name);
    if (this.poses.has(valid) && !overwrite) throw new Refused(`pose '${valid}' already exists; ${OVERWRITE}`);
    this.poses.set(valid, pose);
    return `pose ${valid} saved`;
  }

  goTo(name: string): string {
    const pose = this.poses.get(validName(name));
    if (pose === undefined) throw new Refused(`there is no pose ${name}`);
    this.arm.moveTo(pose.arm);
    if (pose.gripper !== null) this.arm.moveGripper(pose.gripper);
    return `moving to ${validName(name)}, 3 s`;
  }

  /** Rename an entry, or delete it if `newName` is empty. */
  renameOrDelete(kind: string, name: string, newName: string): string {
    const entries: Map<string, unknown> = kind === "pose" ? this.poses : this.sequences;
    const entry = entries.get(validName(name));
    if (entry === undefined) throw new Refused(`there is no ${kind} ${name}`);
    if (newName === "") {
      entries.delete(validName(name));
      return "deleted";
    }
    if (entries.has(validName(newName))) throw new Refused(`${kind} '${newName}' already exists; choose another name`);
    entries.delete(validName(name));
    entries.set(validName(newName), entry);
    return `renamed to ${validName(newName)}`;
  }

  record(request: { action: string; name: string; mode: string; include_gripper: boolean; overwrite: boolean }): {
    message: string;
    durationS: number;
    waypoints: number;
  } {
    const mode = request.mode === "" ? "teleop" : request.mode;
    if (request.action === "start") {
      this.requireIdle();
      if (mode === "kinesthetic") this.arm.torque = false;
      this.activity = { kind: "recording", name: request.name, mode, includeGripper: request.include_gripper, beganS: this.nowS, durationS: 0 };
      return { message: `recording, ${mode}`, durationS: 0, waypoints: 0 };
    }
    const { activity } = this;
    if (activity?.kind !== "recording") throw new Refused("nothing is being recorded");
    const durationS = round(this.nowS - activity.beganS, 2);
    const waypoints = Math.floor(durationS * SAMPLE_HZ) + 1;
    let message = "recording discarded";
    if (request.action === "save") {
      const name = validName(request.name === "" ? activity.name : request.name);
      if (this.sequences.has(name) && !request.overwrite) throw new Refused(`sequence '${name}' already exists; ${OVERWRITE}`);
      this.sequences.set(name, { mode: activity.mode, includeGripper: activity.includeGripper, durationS, waypoints });
      message = `sequence ${name} saved`;
    }
    this.endActivity();
    return { message: activity.mode === "kinesthetic" ? `${message}; torque on` : message, durationS, waypoints };
  }

  play(name: string, speed: number): string {
    this.requireIdle();
    const sequence = this.sequences.get(validName(name));
    if (sequence === undefined) throw new Refused(`there is no sequence ${name}`);
    const factor = speed === 0 ? 1 : speed; // 0, an unset field of the request, means the recorded speed
    const durationS = Math.max(0.1, sequence.durationS / Math.min(2, Math.max(0.25, factor)));
    this.arm.torque = true;
    this.arm.moveTo([0.6, 0.2, -0.4, -1], durationS);
    this.activity = { kind: "playing", name, mode: sequence.mode, includeGripper: sequence.includeGripper, beganS: this.nowS, durationS };
    return `playing ${name}, ${durationS.toFixed(1)} s`;
  }

  stop(): string {
    const { activity } = this;
    this.arm.stop();
    this.endActivity();
    return activity === null ? "nothing was running" : `${activity.kind} ended`;
  }

  private endActivity(): void {
    if (this.activity?.mode === "kinesthetic") this.arm.torque = true;
    this.activity = null;
  }

  private requireIdle(): void {
    if (this.activity !== null) throw new Refused(`the arm is busy: ${this.activity.kind} ${this.activity.name}; stop that first`);
  }
}

function validName(name: string): string {
  const valid = name.trim().toLowerCase();
  if (!NAME.test(valid)) throw new Refused("a name has 1 to 32 of a–z, 0–9, _ and -, and begins with a letter or digit");
  return valid;
}

function round(value: number, places: number): number {
  return Number(value.toFixed(places));
}
