import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { SERVICES, TOPICS } from "@/generated/graph";
import type { lupin_msgs_CalibrateArm_Response, lupin_msgs_MissionState, nav_msgs_Odometry, trajectory_msgs_JointTrajectory } from "@/generated/messages";
import { ARM_PRESETS } from "@/generated/robot";
import { CallFailed, Rosbridge } from "@/ros/rosbridge";
import { MockAuthority, OTHER } from "./authority";
import { readOptions } from "./options";
import { RosbridgeServer } from "./rosbridge_server";
import { SAMPLES } from "./samples";
import { World } from "./world";

function start(query: string) {
  const options = readOptions(new URLSearchParams(query));
  const world = new World(options);
  const authority = new MockAuthority(options, world, () => {});
  const server = new RosbridgeServer({ world, authority, maps: new Set() });
  const link = new Rosbridge(() => server.open());
  link.connect();
  const run = async (seconds: number) => {
    for (let passed = 0; passed < seconds; passed += 0.02) {
      await vi.advanceTimersByTimeAsync(20);
      world.advance(0.02);
      server.publish(performance.now());
    }
  };
  const call = async (row: { name: string; type: string }, request: unknown = {}) => {
    const answer = link.call(row.name, row.type, request);
    answer.catch(() => {});
    await run(0.1);
    return answer;
  };
  return { world, authority, link, run, call };
}

/** Sampled only when something happens: a tag is read, the arm is commanded, navigation has a goal. */
const EVENTS: readonly string[] = [TOPICS.OBSERVATIONS.name, TOPICS.ARM_TRAJECTORY.name, TOPICS.CMD_VEL_NAV.name];

beforeEach(() => vi.useFakeTimers());
afterEach(() => vi.useRealTimers());

describe("the mock robot", () => {
  it("has the rates of the specification", () => {
    const rates = { IMU: 50, SCAN: 10, ODOM: 30, JOINT_STATES: 30, BATTERY: 1, MISSION_STATE: 5, OBSERVATIONS: 5, TWIN_STATE: 1, PLAN: 5, MAP: 0.2, ROSOUT: 0.5 };
    const rateOf = (key: keyof typeof rates) => SAMPLES.find(({ name }) => name === TOPICS[key].name)?.rateHz;
    expect(Object.fromEntries(Object.keys(rates).map((key) => [key, rateOf(key as keyof typeof rates)]))).toEqual(rates);
  });

  it("samples every topic at its rate", async () => {
    const { link, run } = start("state=mission");
    await run(0.2);
    const counts = new Map<string, number>();
    for (const { name, type } of SAMPLES) link.subscribe(name, type, {}, () => counts.set(name, (counts.get(name) ?? 0) + 1));
    await run(6);
    for (const { name, rateHz } of SAMPLES) {
      if (EVENTS.includes(name)) continue;
      const count = counts.get(name) ?? 0;
      expect(count, name).toBeGreaterThanOrEqual(Math.floor(6 * rateHz * 0.8));
      expect(count, name).toBeLessThanOrEqual(Math.ceil(6 * rateHz * 1.2) + 2);
    }
  });

  it("drives on to its goal after the sticks were let go of", async () => {
    const { world, link, run } = start("state=calm");
    await run(0.2);
    let commands = 0;
    link.subscribe(TOPICS.CMD_VEL_NAV.name, TOPICS.CMD_VEL_NAV.type, {}, () => (commands += 1));
    await run(0.2);
    expect([world.winner, commands]).toEqual(["zero", 0]);
    world.sendGoal({ ...world.pose, x: world.pose.x + 0.8 });
    await run(0.4);
    expect(world.winner).toBe("auto");
    world.driveByHand({ x: 0, y: 0, yaw: 0.1 });
    const before = commands;
    await run(0.3);
    expect(world.winner).toBe("manual");
    expect(commands).toBeGreaterThan(before);
    await run(0.5);
    expect(world.winner).toBe("auto");
    await run(5);
    expect(world.winner).toBe("zero");
  });

  it("throttles as a subscriber asks", async () => {
    const { link, run } = start("state=mission");
    await run(0.2);
    let count = 0;
    link.subscribe(TOPICS.TF.name, TOPICS.TF.type, { throttleMs: 100 }, () => (count += 1));
    await run(2);
    expect(count).toBeGreaterThan(12);
    expect(count).toBeLessThanOrEqual(20);
  });

  it("drives by hand while it is not stopped, and only for whoever has control", async () => {
    const { world, authority, link, run } = start("state=calm&control=free");
    await run(0.2);
    const drive = async (seconds: number) => {
      for (let passed = 0; passed < seconds; passed += 0.1) {
        link.publish(TOPICS.CMD_VEL_MANUAL.name, TOPICS.CMD_VEL_MANUAL.type, { linear: { x: 0.4, y: 0, z: 0 }, angular: { x: 0, y: 0, z: 0 } });
        await run(0.1);
      }
    };
    const before = { ...world.pose };
    await drive(1);
    const driven = Math.hypot(world.pose.x - before.x, world.pose.y - before.y);
    expect(driven).toBeGreaterThan(0.3);
    expect(authority.hasControl).toBe(true);

    link.publish(TOPICS.HMI_ESTOP.name, TOPICS.HMI_ESTOP.type, { data: true });
    const stopped = { ...world.pose };
    await drive(0.5);
    expect(world.pose).toEqual(stopped);
    link.publish(TOPICS.HMI_ESTOP.name, TOPICS.HMI_ESTOP.type, { data: false });
    await run(0.6);
    expect(world.isStopped).toBe(false);
    expect(world.pose).toEqual(stopped);
  });

  it("refuses commands while another browser has control", async () => {
    const { link, run, call } = start("state=calm&control=phone");
    await run(0.2);
    const refusals: string[] = [];
    link.onStatus = (_, text) => refusals.push(text);
    link.publish(TOPICS.CMD_VEL_MANUAL.name, TOPICS.CMD_VEL_MANUAL.type, { linear: { x: 0.4, y: 0, z: 0 }, angular: { x: 0, y: 0, z: 0 } });
    expect(refusals[0]).toContain(`${OTHER} has had control`);
    await expect(call(SERVICES.MISSION_PAUSE)).rejects.toThrow(CallFailed);
    await expect(call(SERVICES.SLAM_RESET)).rejects.toThrow("not allowed");
  });

  it("gives a viewer control by no request", () => {
    for (const query of ["role=viewer&state=mission", "role=viewer&state=calm&control=asked", "role=viewer&control=free"]) {
      const { authority } = start(query);
      for (const action of ["take", "request", "take_over"]) expect(() => authority.lease(action, "")).toThrow("is a viewer");
      expect(authority.control).toEqual({ holder: null, since_s: null, requester: null });
    }
    const { authority } = start("role=viewer&control=phone");
    for (const action of ["request", "take_over"]) expect(() => authority.lease(action, OTHER)).toThrow("is a viewer");
    expect(authority.control.holder).toBe(OTHER);
  });

  it("runs, pauses, skips and aborts missions", async () => {
    const { world, run, call } = start("state=calm");
    await run(0.2);
    const state = () => world.mission.state(0) as lupin_msgs_MissionState;
    expect(state().lifecycle_state).toBe("READY");
    expect(await call(SERVICES.MISSION_START, { tag_sequence: ["99"] })).toMatchObject({ accepted: false });
    expect(await call(SERVICES.MISSION_START, { mission_type: "", tag_sequence: [], discovery_goal: 0 })).toMatchObject({ accepted: true });
    await run(5);
    expect(state()).toMatchObject({ lifecycle_state: "INSPECTING", mission_phase: "NAVIGATING", targets_completed: 0, targets_total: 4 });
    expect(await call(SERVICES.MISSION_PAUSE)).toEqual({ success: true, message: "" });
    const paused = { ...world.pose };
    await run(2);
    expect(world.pose).toEqual(paused);
    await call(SERVICES.MISSION_RESUME);
    await call(SERVICES.MISSION_SKIP);
    expect(state()).toMatchObject({ targets_skipped: 1, targets_completed: 0 });
    await call(SERVICES.MISSION_ABORT);
    expect(state().lifecycle_state).toBe("RETURNING");
    await run(10);
    expect(state().lifecycle_state).toBe("READY");
  });

  it("answers typed: lights with a status, triggers without words, the calibration in two states", async () => {
    const { run, call } = start("state=calm");
    await run(0.2);
    expect(await call(SERVICES.LEDS_SET, { color: { r: 255, g: 0, b: 0 } })).toEqual({ status: true });
    expect(await call(SERVICES.LEDS_AUTO)).toEqual({ success: true, message: "" });
    const calibrate = async (action: string) => (await call(SERVICES.ARM_CALIBRATE, { action })) as lupin_msgs_CalibrateArm_Response;
    expect(await calibrate("commit")).toMatchObject({ success: false, state: "IDLE" });
    expect(await calibrate("start")).toMatchObject({ success: true, state: "AWAITING_POSE", joint_names: [] });
    expect(await calibrate("start")).toMatchObject({ success: false });
    const committed = await calibrate("commit");
    expect(committed).toMatchObject({ success: true, state: "IDLE", offsets_applied: [312, 0, 0, 1204], diffs_observed: [312, -148, 96, 1204] });
    expect(committed.joint_names).toHaveLength(4);
  });

  it("publishes the trajectory of a commanded move once, and moves the arm", async () => {
    const { world, link, run, call } = start("state=calm");
    await run(0.2);
    const trajectories: trajectory_msgs_JointTrajectory[] = [];
    link.subscribe(TOPICS.ARM_TRAJECTORY.name, TOPICS.ARM_TRAJECTORY.type, {}, (message) => trajectories.push(message as trajectory_msgs_JointTrajectory));
    await call(SERVICES.ARM_PRESET, { name: "tuck" });
    await run(3.5);
    expect(trajectories).toHaveLength(1);
    expect([...(trajectories[0]?.points[0]?.positions ?? [])]).toEqual([...ARM_PRESETS.tuck]);
    expect(world.arm.position).toEqual([...ARM_PRESETS.tuck]);
  });

  it("sends NaN and empty messages when asked for them", async () => {
    const nan = start("state=calm&fault=nan");
    await nan.run(0.2);
    const samples: nav_msgs_Odometry[] = [];
    nan.link.subscribe(TOPICS.ODOM.name, TOPICS.ODOM.type, {}, (message) => samples.push(message as nav_msgs_Odometry));
    await nan.run(0.2);
    expect(samples[0]?.pose.pose.position.x).toBeNaN();
    const empty = start("state=calm&fault=empty");
    await empty.run(0.2);
    let scan: unknown;
    empty.link.subscribe(TOPICS.SCAN.name, TOPICS.SCAN.type, {}, (message) => (scan = message));
    await empty.run(0.2);
    expect(scan).toMatchObject({ ranges: new Float32Array(0), angle_min: 0, header: { frame_id: "" } });
  });

  it("stands still at a chosen time", () => {
    const one = new World(readOptions(new URLSearchParams("state=mission&clock=12")));
    const other = new World(readOptions(new URLSearchParams("state=mission&clock=12")));
    other.advance(5);
    expect(other.pose).toEqual(one.pose);
    expect(other.clockS).toBe(one.clockS);
  });
});
