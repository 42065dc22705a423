/** A rosbridge server in the page: the other end of the client's socket. */
import { encode } from "cbor2";
import { ACTIONS, TOPICS } from "@/generated/graph";
import type { geometry_msgs_Pose, geometry_msgs_Twist } from "@/generated/messages";
import type { Socket } from "@/ros/rosbridge";
import { type Pose2, yawOf } from "@/ros/tf";
import { clampVelocity, isZero } from "@/safety/drive";
import { emptied, withoutNumbers } from "./faults";
import { isLost, isSilent, whenLost } from "./link_state";
import { poseStamped, time } from "./messages";
import { SAMPLES, type SampleRow, previewPath } from "./samples";
import { say } from "./sentences";
import { type MockRobot, answerService, ruleOf } from "./services";

const OPENS_AFTER_MS = 60;
const OPENS_SLOWLY_AFTER_MS = 900;
const ANSWERS_AFTER_MS = 7;
const PLANS_AFTER_MS = 160;
const FEEDBACK_MS = 500;
const OPEN = 1;
const CLOSED = 3;

type Frame = Record<string, unknown>;

interface Subscription {
  row: SampleRow;
  throttleMs: number;
  sentMs: number;
}

export class RosbridgeServer {
  private clients = new Set<Client>();
  private dueMs = new Map<SampleRow, number>();

  constructor(readonly robot: MockRobot) {}

  /** A socket to this server. Throws while the link is lost. */
  open(): Socket {
    const { options } = this.robot.world;
    if (isLost(options)) throw new Error("the link is lost");
    const client = new Client(this);
    setTimeout(() => client.opened(), options.state === "boot" ? OPENS_SLOWLY_AFTER_MS : OPENS_AFTER_MS);
    whenLost(options, () => client.close());
    return client;
  }

  /** Send the samples that are due. */
  publish(nowMs: number): void {
    if (this.isSilent) return;
    for (const row of SAMPLES) {
      if (nowMs < (this.dueMs.get(row) ?? 0)) continue;
      // Of several periods that were missed, as by a hidden page, one is made up for.
      this.dueMs.set(row, Math.max((this.dueMs.get(row) ?? nowMs) + 1000 / row.rateHz, nowMs));
      const listeners = [...this.clients].filter((client) => client.isDue(row, nowMs));
      if (listeners.length === 0) continue;
      for (const frame of this.frames(row)) for (const client of listeners) client.deliver(row, frame, nowMs);
    }
  }

  /** The last sample of a latched topic for a new subscriber. */
  frames(row: SampleRow): ArrayBuffer[] {
    const { world } = this.robot;
    const { faults } = world.options;
    if (faults.has("none")) return [];
    if (world.options.state === "boot" && row.name === TOPICS.SCAN.name) return [];
    return row.make(world).map((message) => {
      const msg = faults.has("nan") ? withoutNumbers(message) : faults.has("empty") ? emptied(message) : message;
      return new Uint8Array(encode({ op: "publish", topic: row.name, msg })).buffer;
    });
  }

  get isSilent(): boolean {
    return isSilent(this.robot.world.options);
  }

  join(client: Client): void {
    this.clients.add(client);
  }

  leave(client: Client): void {
    this.clients.delete(client);
  }
}

class Client implements Socket {
  binaryType = "";
  readyState = 0;
  onopen: (() => void) | null = null;
  onclose: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  private subscriptions = new Map<string, Subscription>();
  /** The ids of the goals that drive. */
  private drives = new Set<string>();

  constructor(private readonly server: RosbridgeServer) {}

  opened(): void {
    if (this.readyState === CLOSED) return;
    this.readyState = OPEN;
    this.server.join(this);
    this.onopen?.();
  }

  close(): void {
    if (this.readyState === CLOSED) return;
    this.readyState = CLOSED;
    this.server.leave(this);
    this.onclose?.();
  }

  send(text: string): void {
    const frame = JSON.parse(text) as Frame;
    const id = String(frame["id"] ?? "");
    switch (frame["op"]) {
      case "subscribe":
        this.subscribe(id, String(frame["topic"]), Number(frame["throttle_rate"] ?? 0));
        break;
      case "unsubscribe":
        this.subscriptions.delete(id);
        break;
      case "publish":
        this.attempt(() => this.published(String(frame["topic"]), frame["msg"] as Frame, id));
        break;
      case "call_service":
        setTimeout(() => this.called(id, String(frame["service"]), (frame["args"] ?? {}) as Frame), ANSWERS_AFTER_MS);
        break;
      case "send_action_goal":
        this.goalSent(id, String(frame["action"]), (frame["args"] ?? {}) as Frame);
        break;
      case "cancel_action_goal":
        // Not where only a path was asked for.
        if (this.drives.delete(id)) this.server.robot.world.cancelGoal();
        break;
    }
  }

  isDue(row: SampleRow, nowMs: number): boolean {
    return [...this.subscriptions.values()].some((each) => each.row === row && nowMs - each.sentMs >= each.throttleMs);
  }

  deliver(row: SampleRow, data: ArrayBuffer, nowMs: number): void {
    for (const each of this.subscriptions.values()) if (each.row === row && nowMs - each.sentMs >= each.throttleMs) each.sentMs = nowMs;
    if (this.readyState === OPEN) this.onmessage?.({ data });
  }

  private subscribe(id: string, topic: string, throttleMs: number): void {
    const row = SAMPLES.find(({ name }) => name === topic);
    if (row === undefined) return;
    this.subscriptions.set(id, { row, throttleMs, sentMs: -Infinity });
    if (!row.latched || this.server.isSilent) return;
    setTimeout(() => {
      if (!this.subscriptions.has(id)) return;
      for (const data of this.server.frames(row)) this.deliver(row, data, performance.now());
    }, ANSWERS_AFTER_MS);
  }

  private published(topic: string, message: Frame, id: string): void {
    const { world, authority } = this.server.robot;
    if (topic === TOPICS.HMI_ESTOP.name) {
      authority.setStop(message["data"] === true, id);
      return;
    }
    const rule = Object.values(TOPICS).find(({ name }) => name === topic)?.console ?? "";
    if (rule !== "operator") throw new Error(say("not_allowed", { what: `publishing on ${topic}` }));
    if (topic === TOPICS.CMD_VEL_MANUAL.name) {
      const { linear, angular } = message as unknown as geometry_msgs_Twist;
      const velocity = clampVelocity({ x: linear.x, y: linear.y, yaw: angular.z });
      if (isZero(velocity)) authority.checkTake();
      else authority.take();
      world.driveByHand(velocity);
      return;
    }
    authority.take();
    if (topic === TOPICS.GOAL_POSE.name && !world.isStopped) {
      world.sendGoal(planar((message as { pose: geometry_msgs_Pose }).pose));
    }
  }

  private called(id: string, service: string, request: Frame): void {
    try {
      const rule = ruleOf(service);
      if (rule === "") throw new Error(say("not_allowed", { what: `calling ${service}` }));
      if (rule === "operator") this.server.robot.authority.take();
      this.answer({ op: "service_response", id, service, values: answerService(service, request, this.server.robot), result: true });
    } catch (error) {
      this.answer({ op: "service_response", id, service, values: reason(error), result: false });
    }
  }

  private goalSent(id: string, action: string, goal: Frame): void {
    const { world, authority } = this.server.robot;
    const end = (values: unknown, status: number) =>
      this.answer({ op: "action_result", id, action, values, status, result: typeof values !== "string" });
    try {
      if (action === ACTIONS.COMPUTE_PATH_TO_POSE.name) {
        const to = planar((goal as { goal: { pose: geometry_msgs_Pose } }).goal.pose);
        setTimeout(() => end({ path: previewPath(world, to), planning_time: time(0.02), error_code: 0, error_msg: "" }, 4), PLANS_AFTER_MS);
        return;
      }
      authority.take();
      if (world.isStopped) throw new Error("the robot is stopped");
      const poses = (goal as { poses?: { pose: geometry_msgs_Pose }[] }).poses;
      const to = planar((poses?.at(-1) ?? (goal as { pose: { pose: geometry_msgs_Pose } }).pose).pose);
      const beganS = world.timeS;
      const timer = setInterval(() => {
        const distance = Math.hypot(to.x - world.pose.x, to.y - world.pose.y);
        const values = {
          current_pose: poseStamped(world.clockS, "map", world.pose),
          navigation_time: time(world.timeS - beganS),
          estimated_time_remaining: time(distance / 0.4),
          number_of_recoveries: 0,
          distance_remaining: distance,
        };
        this.answer({ op: "action_feedback", id, action, values });
      }, FEEDBACK_MS);
      this.drives.add(id);
      world.sendGoal(to, (status) => {
        this.drives.delete(id);
        clearInterval(timer);
        end({ error_code: 0, error_msg: "" }, status);
      });
    } catch (error) {
      end(reason(error), 0);
    }
  }

  private attempt(act: () => void): void {
    try {
      act();
    } catch (error) {
      this.answer({ op: "status", level: "error", msg: reason(error) });
    }
  }

  private answer(frame: Frame): void {
    if (this.readyState === OPEN) this.onmessage?.({ data: toJson(frame) });
  }
}

function planar({ position, orientation }: geometry_msgs_Pose): Pose2 {
  return { x: position.x, y: position.y, yaw: yawOf(orientation) };
}

function reason(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

/** JSON as the server writes it: typed arrays as arrays, NaN and infinities as null. */
export function toJson(value: unknown): string {
  return JSON.stringify(value, (_, each: unknown) => (ArrayBuffer.isView(each) ? Array.from(each as unknown as ArrayLike<number>) : each));
}
