/** The mock mission as its services command it, and as `/mission/state` shows it. */
import type { lupin_msgs_MissionState } from "@/generated/messages";
import { DONE_S, LOOP_S, type LoopState, READY_S, TAGS_PER_MISSION, legBeginS, loopState } from "./mission_loop";
import { TAGS } from "./greenhouse";

const EXPLORATION = "ExplorationMission";
/** How many tags an exploration finds before it visits them. */
const EXPLORED_TAGS = 2;

export interface MissionTarget {
  id: string;
  /** Its place in TAGS; null for a tag that the greenhouse does not have. */
  index: number | null;
}

export class MockMission {
  /** Mission time, which stands still while the mission is paused or not running. */
  timeS: number;
  paused = false;
  private type = "InspectionMission";
  private sequence: string[] | null = null;
  private skipped = new Set<number>();
  private lastEvent = "";
  private lastError = "";
  private severity = 0;

  /** `isLooping`: whether the next mission begins by itself. */
  constructor(
    public isLooping: boolean,
    startS = 0,
  ) {
    this.timeS = startS;
  }

  get loop(): LoopState {
    return loopState(this.timeS);
  }

  /** Whether a mission is under way, so that time moves it. */
  get isRunning(): boolean {
    return !["ready", "done"].includes(this.loop.phase);
  }

  /** The mission's tags in their order. */
  get targets(): MissionTarget[] {
    const first = (this.loop.loop % 2) * TAGS_PER_MISSION;
    const own = TAGS.slice(first, first + TAGS_PER_MISSION).map((tag) => tag.id);
    return (this.sequence ?? own).slice(0, TAGS_PER_MISSION).map((id) => {
      const index = TAGS.findIndex((tag) => tag.id === id);
      return { id, index: index < 0 ? null : index };
    });
  }

  /** The tag that the robot is driving to, or reads. */
  get target(): MissionTarget | null {
    const { phase, tag } = this.loop;
    return ["navigating", "scanning", "publishing"].includes(phase) ? (this.targets[tag] ?? null) : null;
  }

  advance(stepS: number): void {
    const before = this.loop;
    if (!this.isLooping && before.phase === "ready") return;
    if (this.paused && this.isRunning) return;
    this.timeS += stepS;
    const after = this.loop;
    if (after.loop !== before.loop) this.reset();
    if (["navigating", "scanning", "publishing"].includes(after.phase) && after.tag >= this.targets.length) {
      this.timeS = legBeginS(after.loop, TAGS_PER_MISSION);
    }
    if (after.phase === "publishing" && before.phase === "scanning") this.note(`tag ${this.target?.id ?? ""} read`);
    if (after.phase === "done" && before.phase === "returning") this.note("mission done");
  }

  start(request: { mission_type: string; tag_sequence: string[] }): string {
    if (this.isRunning) throw new Error("mission already running");
    const unknown = request.tag_sequence.filter((id) => !TAGS.some((tag) => tag.id === id));
    if (unknown.length > 0) throw new Error(`unknown tags: ${unknown.join(", ")}`);
    const { loop, phase } = this.loop;
    this.reset();
    this.type = request.mission_type === "" ? "InspectionMission" : request.mission_type;
    this.sequence = request.tag_sequence.length > 0 ? request.tag_sequence : null;
    this.timeS = (phase === "done" ? loop + 1 : loop) * LOOP_S + READY_S;
    this.note("mission started");
    return this.id;
  }

  pause(): void {
    if (!this.isRunning) throw new Error("there is no mission to pause");
    if (this.paused) throw new Error("the mission is already paused");
    this.paused = true;
    this.note("paused by the operator");
  }

  resume(stopped: boolean): void {
    if (!this.paused) throw new Error("the mission is not paused");
    if (stopped) throw new Error("the robot is stopped; release it first");
    this.paused = false;
    this.note("resumed");
  }

  abort(): void {
    const { loop, phase, tag } = this.loop;
    if (!this.isRunning) throw new Error("there is no mission to abort");
    for (let index = tag; index < this.targets.length; index += 1) this.skipped.add(index);
    this.timeS = phase === "returning" ? (loop + 1) * LOOP_S - DONE_S : legBeginS(loop, TAGS_PER_MISSION);
    this.paused = false;
    this.isLooping = false;
    this.note("mission aborted", 1);
  }

  skip(): void {
    const { loop, phase, tag } = this.loop;
    if (!["navigating", "scanning", "publishing"].includes(phase)) throw new Error("no tag is being visited");
    this.skipped.add(tag);
    this.timeS = legBeginS(loop, tag + 1);
    this.note(`tag ${this.targets[tag]?.id ?? ""} skipped by the operator`, 1);
  }

  /** Pause, as after an e-stop; the operator has to resume. */
  hold(): void {
    if (!this.isRunning) return;
    this.paused = true;
    this.lastError = "estop_engaged";
    this.note("e-stop engaged", 1);
  }

  private get id(): string {
    return `lupin-${(0x5ca1ab1e + this.loop.loop).toString(16).padStart(8, "0")}`;
  }

  private reset(): void {
    this.skipped.clear();
    this.sequence = null;
    this.type = "InspectionMission";
    this.paused = false;
    this.lastError = "";
    this.note("");
  }

  private note(event: string, severity = 0): void {
    this.lastEvent = event;
    this.severity = severity;
  }

  /** The message, but for its header, the stop and the battery. `startS` is when the robot's clock began. */
  state(startedS: number): Omit<lupin_msgs_MissionState, "header" | "estop_engaged" | "battery_percentage" | "battery_low"> {
    const { phase, tag } = this.loop;
    const exploring = this.type === EXPLORATION && tag < EXPLORED_TAGS && phase !== "ready" && phase !== "localizing";
    const closed = phase === "publishing" ? tag + 1 : tag;
    const isIdle = phase === "ready";
    const skipped = [...this.skipped].filter((index) => index < closed).length;
    const lifecycle = this.lifecycle(exploring);
    const isVisiting = ["navigating", "scanning", "publishing"].includes(phase) && !exploring;
    return {
      mission_id: isIdle ? "" : this.id,
      mission_type: isIdle ? "" : this.type,
      lifecycle_state: lifecycle,
      mission_phase: phase === "localizing" ? "LOCALIZING" : isVisiting ? phase.toUpperCase() : "",
      current_target: exploring ? "" : (this.target?.id ?? ""),
      targets_total: isIdle || exploring ? 0 : this.targets.length,
      targets_completed: isIdle ? 0 : Math.max(0, Math.min(closed, this.targets.length) - skipped),
      targets_failed: 0,
      targets_unreachable: 0,
      targets_skipped: isIdle ? 0 : skipped,
      last_error: this.lastError,
      last_event: this.lastEvent,
      last_event_severity: this.severity,
      tags_discovered: this.type === EXPLORATION && !isIdle ? Math.min(TAGS_PER_MISSION, tag + 1) : 0,
      discovery_goal: this.type === EXPLORATION && !isIdle ? TAGS_PER_MISSION : 0,
      paused: this.paused,
      started_at: isIdle ? { sec: 0, nanosec: 0 } : { sec: Math.floor(startedS), nanosec: 0 },
    };
  }

  /** How long ago this mission began, in mission time. */
  get runningS(): number {
    return Math.max(0, this.timeS - this.loop.loop * LOOP_S - READY_S);
  }

  private lifecycle(exploring: boolean): string {
    switch (this.loop.phase) {
      case "ready":
        return "READY";
      case "localizing":
        return "PREPARE";
      case "returning":
        return "RETURNING";
      case "done":
        return "DONE";
      default:
        return exploring ? "EXPLORING" : this.type === EXPLORATION ? "MONITORING" : "INSPECTING";
    }
  }
}
