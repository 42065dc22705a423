/** The answers of the mock services, typed as the real ones. */
import { JOINTS, JOINT_SERVICES, SERVICES, TOPICS } from "@/generated/graph";
import type { ServiceTypes } from "@/generated/messages";
import { ARM_PRESETS, GRIPPER } from "@/generated/robot";
import { ARM } from "@/tabs/arm/joints";
import type { MockAuthority } from "./authority";
import { Refused } from "./arm";
import { TAGS } from "./greenhouse";
import { time } from "./messages";
import { field, tagReading } from "./readings";
import { say } from "./sentences";
import type { World } from "./world";

export interface MockRobot {
  world: World;
  authority: MockAuthority;
  maps: Set<string>;
}

type Answer = (request: Record<string, unknown>, robot: MockRobot) => unknown;

const ANSWERS = new Map<string, Answer>();

function answers<Type extends keyof ServiceTypes>(
  { name }: { readonly name: string; readonly type: Type },
  answer: (request: Partial<ServiceTypes[Type]["request"]>, robot: MockRobot) => ServiceTypes[Type]["response"],
): void {
  ANSWERS.set(name, answer as Answer);
}

/** Whether a client may call a service: its rule in the graph's table. */
export function ruleOf(service: string): string {
  if (service.startsWith("/rosapi/")) return "viewer";
  return [...Object.values(SERVICES), ...Object.values(JOINT_SERVICES)].find(({ name }) => name === service)?.console ?? "";
}

/** The answer of a service. Throws with the reason if there is no such service. */
export function answerService(service: string, request: Record<string, unknown>, robot: MockRobot): unknown {
  const answer = ANSWERS.get(service);
  if (answer === undefined) throw new Error(`${service} has no server`);
  return answer(request, robot);
}

/** `message` of what succeeded, or the reason for which it was refused. */
function attempt(act: () => string | void): { success: boolean; message: string } {
  try {
    // Empty on purpose: each caller shows its own text.
    return { success: true, message: act() ?? "" };
  } catch (error) {
    return { success: false, message: error instanceof Error ? error.message : String(error) };
  }
}

function requireReleased({ world }: MockRobot): void {
  if (world.isStopped) throw new Refused(say("estop_engaged"));
}

answers(SERVICES.GET_TIME, (_, { world }) => ({ time: time(world.clockS) }));
answers(SERVICES.TOPICS, () => {
  const rows = Object.values(TOPICS);
  return { topics: rows.map(({ name }) => name), types: rows.map(({ type }) => type) };
});
answers(SERVICES.SUBSCRIBERS, () => ({ subscribers: ["/twist_mux"] }));

answers(SERVICES.MISSION_START, (request, robot) => {
  try {
    requireReleased(robot);
    const mission_id = robot.world.mission.start({ mission_type: request.mission_type ?? "", tag_sequence: request.tag_sequence ?? [] });
    return { accepted: true, mission_id, error_message: "" };
  } catch (error) {
    return { accepted: false, mission_id: "", error_message: error instanceof Error ? error.message : String(error) };
  }
});
answers(SERVICES.MISSION_PAUSE, (_, { world }) => attempt(() => world.mission.pause()));
answers(SERVICES.MISSION_RESUME, (_, { world }) => attempt(() => world.mission.resume(world.isStopped)));
answers(SERVICES.MISSION_ABORT, (_, { world }) => attempt(() => world.mission.abort()));
answers(SERVICES.MISSION_SKIP, (_, { world }) => attempt(() => world.mission.skip()));
answers(SERVICES.MISSION_DOCK, (_, { world }) => attempt(() => world.mission.abort()));
answers(SERVICES.MISSION_RESET, () => ({ success: false, message: "the mission has no fault to recover from" }));

answers(SERVICES.GET_TAG_READING, ({ tag_id = "" }, { world }) => {
  const tag = TAGS.find(({ id }) => id === tag_id);
  const empty = { tag_id, stamp: time(0), sim_time_of_day_seconds: 0, readings: [] };
  if (tag === undefined) return { status: 1, error_message: `unknown tag ${tag_id}`, reading: empty };
  return { status: 0, error_message: "", reading: tagReading(tag, world) };
});
answers(SERVICES.GET_FIELD, (request, { world }) => field(request, world));

answers(SERVICES.CLEAR_MAP, () => ({ success: true, message: "" }));
answers(SERVICES.SLAM_SAVE_MAP, ({ name }, { maps }) => {
  maps.add(name?.data ?? "map");
  return { result: 0 };
});
answers(SERVICES.SLAM_SERIALIZE, () => ({ result: 0 }));

answers(SERVICES.ARM_PRESET, ({ name = "" }, robot) =>
  attempt(() => {
    requireReleased(robot);
    const preset = ARM_PRESETS[name.trim().toLowerCase() as keyof typeof ARM_PRESETS];
    if (preset === undefined) throw new Refused(`there is no preset ${name}; there are ${Object.keys(ARM_PRESETS).join(", ")}`);
    robot.world.arm.moveTo(preset);
  }),
);
answers(SERVICES.ARM_SET_TORQUE, ({ data = false }, robot) =>
  attempt(() => {
    const { world } = robot;
    if (!data) requireReleased(robot);
    if (world.arm.calibration !== "IDLE") throw new Refused("a calibration is in progress: commit or cancel it first");
    if (!data) world.arm.stop();
    world.arm.torque = data;
  }),
);
answers(SERVICES.ARM_INIT, () => ({ success: true, message: "" }));
answers(SERVICES.ARM_CALIBRATE, ({ action = "" }, robot) => {
  const { arm } = robot.world;
  try {
    if (action === "start") requireReleased(robot);
    const { state, message, joints, offsets, diffs } = arm.calibrate(action.trim().toLowerCase());
    return { success: true, state, message, joint_names: joints, offsets_applied: Int32Array.from(offsets), diffs_observed: Int32Array.from(diffs) };
  } catch (error) {
    const message = error instanceof Error ? error.message : String(error);
    return { success: false, state: arm.calibration, message, joint_names: [], offsets_applied: new Int32Array(), diffs_observed: new Int32Array() };
  }
});

answers(SERVICES.ARM_LIBRARY_LIST, (_, { world }) => ({ success: true, json: world.library.listing() }));
answers(SERVICES.ARM_LIBRARY_SAVE_POSE, (request, { world }) =>
  attempt(() => {
    const arm = request.from_current === true ? [...world.arm.position] : Array.from(request.arm_rad ?? []);
    const gripper = request.has_gripper === true ? (request.from_current === true ? world.arm.gripper : (request.gripper_rad ?? null)) : null;
    return world.library.savePose(request.name ?? "", { arm, gripper, note: "" }, request.overwrite ?? false);
  }),
);
answers(SERVICES.ARM_LIBRARY_GOTO_POSE, ({ name = "" }, robot) =>
  attempt(() => {
    requireReleased(robot);
    return robot.world.library.goTo(name);
  }),
);
answers(SERVICES.ARM_LIBRARY_RECORD, (request, { world }) => {
  try {
    const { message, durationS, waypoints } = world.library.record({
      action: request.action ?? "",
      name: request.name ?? "",
      mode: request.mode ?? "",
      include_gripper: request.include_gripper ?? false,
      overwrite: request.overwrite ?? false,
    });
    return { success: true, message, duration_s: durationS, n_waypoints: waypoints };
  } catch (error) {
    return { success: false, message: error instanceof Error ? error.message : String(error), duration_s: 0, n_waypoints: 0 };
  }
});
answers(SERVICES.ARM_LIBRARY_PLAY, ({ name = "", speed = 0 }, robot) =>
  attempt(() => {
    requireReleased(robot);
    return robot.world.library.play(name, speed);
  }),
);
answers(SERVICES.ARM_LIBRARY_STOP, (_, { world }) => attempt(() => world.library.stop()));
answers(SERVICES.ARM_LIBRARY_DELETE, (request, { world }) =>
  attempt(() => world.library.renameOrDelete(request.kind ?? "", request.name ?? "", request.new_name ?? "")),
);
answers(SERVICES.GRIPPER_ANGLE, ({ angle = 0, degrees = true }, robot) => {
  if (robot.world.isStopped) return { status: false };
  robot.world.arm.moveGripper(gripperRad(degrees ? angle : (angle * 180) / Math.PI));
  return { status: true };
});

for (const [index, { name, service }] of ARM.entries()) {
  if (name === JOINTS.gripper) continue;
  answers(service, ({ angle = 0, rate = 0, degrees = true }, robot) => {
    const { arm } = robot.world;
    const unit = degrees ? Math.PI / 180 : 1;
    const target = arm.position.map((position, each) => (each === index ? angle * unit : position));
    try {
      requireReleased(robot);
      arm.moveTo(target, Math.abs((target[index] ?? 0) - (arm.position[index] ?? 0)) / (rate > 0 ? rate * unit : Math.PI / 3));
      return { status: true };
    } catch {
      return { status: false };
    }
  });
}

answers(SERVICES.LEDS_SET, () => ({ status: true }));
answers(SERVICES.LEDS_AUTO, () => ({ success: true, message: "" }));

for (const row of [SERVICES.CANCEL_NAVIGATE_TO_POSE, SERVICES.CANCEL_NAVIGATE_THROUGH_POSES, SERVICES.CANCEL_FOLLOW_WAYPOINTS]) {
  answers(row, (_, { world }) => {
    world.cancelGoal();
    return { return_code: 0, goals_canceling: [] };
  });
}

/** The gripper's joint angle for an angle on the operator's scale. */
function gripperRad(angleDeg: number): number {
  const share = (angleDeg - GRIPPER.openDeg) / (GRIPPER.closedDeg - GRIPPER.openDeg);
  return GRIPPER.openRad + Math.min(1, Math.max(0, share)) * (GRIPPER.closedRad - GRIPPER.openRad);
}
