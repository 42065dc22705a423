// @vitest-environment jsdom
import { beforeEach, describe, expect, it, vi } from "vitest";
import { createArm } from "./arm_model";
import { ARM } from "./joints";

type Answer = { success?: boolean; status?: boolean; message?: string };
const calls: { name: string; request: Record<string, unknown>; answer: (value: Answer) => void; fail: (error: Error) => void }[] = [];

vi.mock("@/robot/commands", () => ({
  call: (row: { name: string }, request: Record<string, unknown>) =>
    new Promise((answer, fail) => calls.push({ name: row.name, request, answer, fail })),
}));
vi.mock("@/state/problems", () => ({ showProblem: vi.fn<() => void>(), showDone: vi.fn<() => void>() }));

const elbow = ARM[2]!;
const settle = () => new Promise((done) => setTimeout(done, 0));

function trajectory(elbowRad: number) {
  return {
    joint_names: ["elbow_joint"],
    points: [{ positions: [elbowRad], time_from_start: { sec: 1, nanosec: 0 } }],
  } as unknown as Parameters<ReturnType<typeof createArm>["onTrajectory"]>[0];
}

describe("the arm's model", () => {
  beforeEach(() => void calls.splice(0));

  it("begins with an unknown torque and sliders that follow", () => {
    const { store } = createArm();
    expect(store.getState()).toMatchObject({ torque: null, thumbs: {}, commands: {} });
  });

  it("sends one angle at a time, and then only the newest", async () => {
    const arm = createArm();
    for (const degrees of [10, 20, 30]) arm.move(elbow, degrees, 0);
    expect(calls.map(({ request }) => request["angle"])).toEqual([10]);
    calls[0]?.answer({ status: true });
    await settle();
    expect(calls.map(({ request }) => request["angle"])).toEqual([10, 30]);
    expect(calls[0]?.request).toEqual({ angle: 10, rate: 60, degrees: true });
    expect(calls[0]?.name).toBe("/lupin/arm/elbow/set_angle_with_speed");
  });

  it("knows no command before the robot accepted it, and none that it refused", async () => {
    const arm = createArm();
    arm.move(elbow, 500, 0);
    expect(arm.store.getState()).toMatchObject({ thumbs: { elbow_joint: 90 }, commands: {} });
    calls[0]?.answer({ status: false });
    await settle();
    expect(arm.store.getState()).toMatchObject({ thumbs: {}, commands: {} });
  });

  it("lets a slider follow once somebody else commands its joint", async () => {
    const arm = createArm();
    arm.move(elbow, 57.3, 0);
    calls[0]?.answer({ status: true });
    await settle();
    arm.onTrajectory(trajectory(1));
    expect(arm.store.getState().thumbs).toEqual({ elbow_joint: 57.3 });
    arm.onTrajectory(trajectory(0.2));
    expect(arm.store.getState().thumbs).toEqual({});
    expect(arm.store.getState().commands.elbow_joint?.targetDeg).toBeCloseTo(11.46, 2);
  });

  it("is armed by a confirmed switch only", async () => {
    const arm = createArm();
    void arm.switchTorque(true);
    expect(arm.store.getState()).toMatchObject({ torque: null, switchingTo: true });
    calls[0]?.answer({ success: true, message: "stiff" });
    await settle();
    expect(arm.store.getState()).toMatchObject({ torque: true, switchingTo: null, answer: "stiff" });
    void arm.switchTorque(false);
    calls[1]?.fail(new Error("no answer"));
    await settle();
    expect(arm.store.getState()).toMatchObject({ torque: null, switchingTo: null });
  });

  it("forgets its commands when the arm becomes limp", async () => {
    const arm = createArm();
    arm.applyTorqueEvent({ kind: "confirmed", on: true });
    void arm.goToPreset("tuck");
    calls[0]?.answer({ success: true, message: "sent" });
    await settle();
    expect(arm.store.getState().commands.elbow_joint?.targetDeg).toBeCloseTo(80.2, 1);
    arm.applyTorqueEvent({ kind: "reported", on: false });
    expect(arm.store.getState()).toMatchObject({ torque: false, commands: {} });
  });
});
