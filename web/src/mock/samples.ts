/** The mock topics: at which rate each is sampled, and its sample. */
import { JOINTS, TOPICS } from "@/generated/graph";
import { BATTERY } from "@/generated/robot";
import type { MessageTypes, action_msgs_GoalStatus, nav_msgs_OccupancyGrid, sensor_msgs_CameraInfo } from "@/generated/messages";
import { LIDAR, WHEEL } from "@/generated/robot";
import { type Pose2, compose } from "@/ros/tf";
import { HEIGHT_CELLS, ORIGIN, RESOLUTION_M, TAGS, WIDTH_CELLS, boxOf, castRay, flowersOf, occupancy } from "./greenhouse";
import { header, noise, pose, poseStamped, quaternion, time, transform } from "./messages";
import { costmap, localCostmap } from "./costmap";
import { logLines } from "./log_lines";
import { discoveredTags, observation, twinState } from "./readings";
import { IMAGE, frontCamera, gripperCamera, seenFlowers, seenTags } from "./view";
import { type World, line } from "./world";

export interface SampleRow {
  name: string;
  type: keyof MessageTypes;
  rateHz: number;
  /** A late subscriber gets the last sample at once. */
  latched: boolean;
  /** The messages that are due; none where there is nothing to say. */
  make: (world: World) => unknown[];
}

function row<Type extends keyof MessageTypes>(
  topic: { readonly name: string; readonly type: Type; readonly rateHz: number | null },
  make: (world: World) => MessageTypes[Type] | null,
  { rateHz = topic.rateHz ?? 1, latched = false }: { rateHz?: number; latched?: boolean } = {},
): SampleRow {
  return {
    name: topic.name,
    type: topic.type,
    rateHz,
    latched,
    make: (world) => {
      const message = make(world);
      return message === null ? [] : [message];
    },
  };
}

const MAP_FROM_ODOM: Pose2 = { x: 0.06, y: -0.04, yaw: 0.02 };
const ODOM_FROM_MAP = inverse(MAP_FROM_ODOM);
const LASER: Pose2 = { x: LIDAR.at[0], y: LIDAR.at[1], yaw: LIDAR.yawRad };
const RAYS = 360;
const SCAN_REACH_M = 8;
const GRID = occupancy();
const GROWS_EVERY_S = 5;

/** At the rates of the graph's table, except where the mock needs others or the table has none. */
export const SAMPLES: readonly SampleRow[] = [
  row(TOPICS.IMU, imu),
  row(TOPICS.SCAN, scan),
  row(TOPICS.ODOM, odometry, { rateHz: 30 }),
  row(TOPICS.ODOM_SIM, odometry, { rateHz: 30 }),
  row(TOPICS.JOINT_STATES, jointStates, { rateHz: 30 }),
  row(TOPICS.TF, (world) => ({ transforms: transforms(world) }), { rateHz: 30 }),
  row(TOPICS.TF_STATIC, ({ clockS }) => ({ transforms: [transform(clockS, "base_link", "laser", LASER, LIDAR.at[2])] }), { rateHz: 0.2, latched: true }),
  row(TOPICS.BATTERY, battery),
  row(TOPICS.SIM_BATTERY, ({ batteryFraction }) => ({ data: batteryFraction }), { rateHz: 1 }),
  row(TOPICS.CLOCK, ({ clockS }) => ({ clock: time(clockS) }), { rateHz: 10 }),
  row(TOPICS.ESTOP_STATE, (world) => ({ data: world.isStopped }), { latched: true }),
  row(TOPICS.ESTOP_STATUS, (world) => json({ engaged: world.isStopped, reasons: world.stopReasons, warnings: [] }), { latched: true }),
  row(TOPICS.ESTOP_MISSED_PRESS, () => ({ data: false }), { rateHz: 0.2, latched: true }),
  row(TOPICS.ESTOP_BUTTON, ({ clockS, options }) => ({ header: header(clockS, ""), value: options.faults.has("button") })),
  row(TOPICS.CONSOLE_STOP, (world) => json({ server: "mock", engaged: world.isStopped, driving: false, releases: 0 })),
  row(TOPICS.DRIVE_STATUS, driveStatus, { rateHz: 2, latched: true }),
  row(TOPICS.CMD_VEL_SINK_ROBOT, twist),
  row(TOPICS.CMD_VEL_SINK_SIM, twist),
  row(TOPICS.CMD_VEL_NAV, (world) => (world.navigates ? twist(world) : null)),
  row(TOPICS.MISSION_STATE, missionState, { latched: true }),
  row(TOPICS.LEDS_STATUS, (world) => ({ data: world.isStopped ? "e-stop or fault" : "ready" }), { latched: true }),
  row(TOPICS.TWIN_STATE, twinState, { latched: true }),
  row(TOPICS.DISCOVERED_TAGS, discoveredTags, { latched: true }),
  row(TOPICS.OBSERVATIONS, observation, { rateHz: 5 }),
  row(TOPICS.PLAN, plan, { rateHz: 5, latched: true }),
  row(TOPICS.NAVIGATE_STATUS, ({ goals }) => ({ status_list: goals.map(goalStatus) }), { rateHz: 2, latched: true }),
  row(TOPICS.MAP, map, { latched: true }),
  row(TOPICS.GLOBAL_COSTMAP, ({ clockS }) => grid(clockS, costmap(), WIDTH_CELLS, HEIGHT_CELLS, ORIGIN), { latched: true }),
  row(TOPICS.LOCAL_COSTMAP, (world) => localCostmap(world), { latched: true }),
  row(TOPICS.AMCL_POSE, ({ clockS, pose: at }) => ({ header: header(clockS, "map"), pose: { pose: pose(at), covariance: covariance() } }), { rateHz: 1, latched: true }),
  row(TOPICS.TAG_DETECTIONS, tagDetections, { rateHz: 10 }),
  row(TOPICS.FLOWER_DETECTIONS, flowerDetections, { rateHz: 5 }),
  row(TOPICS.BOX_GEOMETRY, () => json(boxes()), { rateHz: 0.5, latched: true }),
  row(TOPICS.ARM_TRAJECTORY, armTrajectory, { rateHz: 20 }),
  row(TOPICS.ARM_LIBRARY_STATE, ({ library }) => ({ data: library.state() }), { latched: true }),
  row(TOPICS.BODY_IMAGE_ROBOT_INFO, ({ clockS }) => cameraInfo(clockS, "camera_color_optical_frame"), { rateHz: 2 }),
  row(TOPICS.GRIPPER_IMAGE_INFO, ({ clockS }) => cameraInfo(clockS, "gripper_camera_optical_frame"), { rateHz: 2 }),
  { name: TOPICS.ROSOUT.name, type: TOPICS.ROSOUT.type, rateHz: 0.5, latched: false, make: logLines },
];

function goalStatus({ stampS, status }: World["goals"][number], index: number): action_msgs_GoalStatus {
  return { goal_info: { goal_id: { uuid: new Uint8Array(16).fill(index + 1) }, stamp: time(stampS) }, status };
}

function json(value: unknown): { data: string } {
  return { data: JSON.stringify(value) };
}

function inverse({ x, y, yaw }: Pose2): Pose2 {
  const cos = Math.cos(yaw);
  const sin = Math.sin(yaw);
  return { x: -cos * x - sin * y, y: sin * x - cos * y, yaw: -yaw };
}

function covariance(): Float64Array {
  const values = new Float64Array(36);
  values[0] = values[7] = 0.004;
  values[35] = 0.002;
  return values;
}

function imu({ clockS, timeS, pose: at, velocity }: World): MessageTypes["sensor_msgs/msg/Imu"] {
  return {
    header: header(clockS, "imu_link"),
    orientation: quaternion(at.yaw),
    orientation_covariance: new Float64Array(9),
    angular_velocity: { x: 0.004 * noise(timeS), y: 0.004 * noise(timeS + 1), z: velocity.yaw + 0.01 * noise(timeS + 2) },
    angular_velocity_covariance: new Float64Array(9),
    linear_acceleration: { x: 0.06 * noise(timeS + 3), y: 0.06 * noise(timeS + 4), z: 9.81 + 0.05 * noise(timeS + 5) },
    linear_acceleration_covariance: new Float64Array(9),
  };
}

function scan({ clockS, timeS, pose: at }: World): MessageTypes["sensor_msgs/msg/LaserScan"] {
  const laser = compose(at, LASER);
  const ranges = new Float32Array(RAYS);
  const increment = (2 * Math.PI) / RAYS;
  for (let ray = 0; ray < RAYS; ray += 1) {
    const { distanceM, hit } = castRay(laser.x, laser.y, laser.yaw - Math.PI + ray * increment, SCAN_REACH_M);
    ranges[ray] = hit === 0 ? Infinity : distanceM + 0.008 * noise(ray + timeS);
  }
  return {
    header: header(clockS, "laser"),
    angle_min: -Math.PI,
    angle_max: Math.PI - increment,
    angle_increment: increment,
    time_increment: 0,
    scan_time: 0.1,
    range_min: 0.12,
    range_max: SCAN_REACH_M,
    ranges,
    intensities: new Float32Array(0),
  };
}

function odometry({ clockS, pose: at, velocity }: World): MessageTypes["nav_msgs/msg/Odometry"] {
  return {
    header: header(clockS, "odom"),
    child_frame_id: "base_link",
    pose: { pose: pose(compose(ODOM_FROM_MAP, at)), covariance: covariance() },
    twist: { twist: twistOf(velocity), covariance: new Float64Array(36) },
  };
}

function jointStates({ clockS, timeS, arm, velocity }: World): MessageTypes["sensor_msgs/msg/JointState"] {
  const wheelRps = [velocity.x - velocity.y, velocity.x + velocity.y, velocity.x - velocity.y, velocity.x + velocity.y].map(
    (speed) => speed / WHEEL.radiusM,
  );
  const shake = (seed: number) => 0.0012 * noise(timeS + seed);
  return {
    header: header(clockS, ""),
    name: [...JOINTS.arm, JOINTS.gripper, ...JOINTS.wheels],
    position: Float64Array.from([...arm.position.map((angle, index) => angle + shake(index)), arm.gripper, ...wheelRps.map((rps) => rps * timeS)]),
    velocity: Float64Array.from([...arm.velocity, 0, ...wheelRps]),
    effort: Float64Array.from([0.1, arm.torque ? 1.4 : 0, arm.torque ? 0.6 : 0, 0.2, 0.1, 0, 0, 0, 0]),
  };
}

/** The trajectory of a move that was commanded just now. */
function armTrajectory({ clockS, arm }: World): MessageTypes["trajectory_msgs/msg/JointTrajectory"] | null {
  const sent = arm.takeSent();
  if (sent === null) return null;
  const empty = new Float64Array(0);
  const point = { positions: Float64Array.from(sent.to), velocities: empty, accelerations: empty, effort: empty, time_from_start: time(sent.durationS) };
  return { header: header(clockS, ""), joint_names: [...JOINTS.arm], points: [point] };
}

function transforms(world: World): MessageTypes["tf2_msgs/msg/TFMessage"]["transforms"] {
  const { clockS, pose: at } = world;
  const moved = transform(clockS, "odom", "base_link", compose(ODOM_FROM_MAP, at));
  return world.isAstray ? [moved] : [transform(clockS, "map", "odom", MAP_FROM_ODOM), moved];
}

function battery({ clockS, timeS, batteryFraction }: World): MessageTypes["sensor_msgs/msg/BatteryState"] {
  const voltage = 10.2 + 2.4 * batteryFraction + 0.02 * noise(timeS);
  return {
    header: header(clockS, ""),
    voltage,
    temperature: NaN,
    current: -1.35 + 0.2 * noise(timeS + 1),
    charge: NaN,
    capacity: NaN,
    design_capacity: NaN,
    percentage: batteryFraction,
    power_supply_status: 2,
    power_supply_health: 1,
    power_supply_technology: 2,
    present: true,
    cell_voltage: Float32Array.from([voltage / 3, voltage / 3 - 0.01, voltage / 3 + 0.01]),
    cell_temperature: new Float32Array(0),
    location: "",
    serial_number: "",
  };
}

function driveStatus(world: World): MessageTypes["std_msgs/msg/String"] {
  const input = (name: string) => ({ age_s: world.winner === name ? 0.02 : null, why: world.winner === name ? "drives" : "silent", rejected: 0 });
  return json({
    winner: world.winner,
    locks: world.isStopped ? ["e-stop"] : [],
    alarms: [],
    sink: { topic: TOPICS.CMD_VEL_SINK_ROBOT.name, listeners: 1 },
    inputs: { joy: input("joy"), manual: input("manual"), auto: input("auto"), zero: input("zero") },
  });
}

function twistOf({ x, y, yaw }: World["velocity"]): MessageTypes["geometry_msgs/msg/Twist"] {
  return { linear: { x, y, z: 0 }, angular: { x: 0, y: 0, z: yaw } };
}

function twist(world: World): MessageTypes["geometry_msgs/msg/Twist"] {
  return twistOf(world.velocity);
}

function missionState(world: World): MessageTypes["lupin_msgs/msg/MissionState"] {
  const { mission, clockS } = world;
  return {
    header: header(clockS, "map"),
    ...mission.state(clockS - mission.runningS),
    ...(world.isAstray ? { last_error: "robot_lost", last_event: "robot lost on the map — waiting until it is found", last_event_severity: 1 } : {}),
    estop_engaged: world.isStopped,
    battery_percentage: world.batteryFraction,
    battery_low: world.batteryFraction < BATTERY.lowShare,
  };
}

function plan(world: World): MessageTypes["nav_msgs/msg/Path"] {
  return path(world.clockS, world.isStopped ? [] : world.path());
}

export function path(clockS: number, poses: readonly Pose2[]): MessageTypes["nav_msgs/msg/Path"] {
  return { header: header(clockS, "map"), poses: poses.map((each) => poseStamped(clockS, "map", each)) };
}

/** A path that nobody follows yet. */
export function previewPath(world: World, to: Pose2): MessageTypes["nav_msgs/msg/Path"] {
  return path(world.clockS, line(world.pose, to));
}

function map({ clockS, timeS, options }: World): nav_msgs_OccupancyGrid {
  if (!options.faults.has("growing")) return grid(clockS, GRID, WIDTH_CELLS, HEIGHT_CELLS, ORIGIN);
  const rows = Math.min(HEIGHT_CELLS, 60 + 20 * Math.floor(timeS / GROWS_EVERY_S));
  return grid(clockS, GRID.slice(0, rows * WIDTH_CELLS), WIDTH_CELLS, rows, ORIGIN);
}

export function grid(clockS: number, data: Int8Array, width: number, height: number, origin: { x: number; y: number }): nav_msgs_OccupancyGrid {
  return {
    header: header(clockS, "map"),
    info: { map_load_time: time(clockS), resolution: RESOLUTION_M, width, height, origin: pose({ ...origin, yaw: 0 }) },
    data,
  };
}

function tagDetections(world: World): MessageTypes["std_msgs/msg/String"] {
  return json(seenTags(frontCamera(world)).map(({ id, corners, distanceM }) => ({ id: Number(id), corners, dist: distanceM, stamp: world.clockS })));
}

/** How far the detector recognizes a flower. */
const DETECTED_M = 1.6;
const CLASS_NAMES = ["tulip_red", "tulip_white", "tulip_pink", "bug"];

function flowerDetections(world: World): MessageTypes["std_msgs/msg/String"] {
  const found = seenFlowers(gripperCamera(world), 0.4)
    .filter(({ u, v, depthM }) => depthM < DETECTED_M && u > 0 && u < IMAGE.width && v > 0 && v < IMAGE.height)
    .map(({ species, u, v, sizePx }, index) => ({
      class: CLASS_NAMES.indexOf(species),
      class_name: species,
      confidence: 0.93 - 0.02 * index,
      bbox_xyxy: [u - sizePx / 2, v - sizePx * 0.6, u + sizePx / 2, v + sizePx / 2].map(Math.round),
      track_id: index + 1,
    }));
  return json(found);
}

function boxes(): unknown[] {
  return TAGS.map((tag) => {
    const corners = boxOf(tag);
    const x = corners.reduce((sum, corner) => sum + corner.x, 0) / corners.length;
    const y = corners.reduce((sum, corner) => sum + corner.y, 0) / corners.length;
    return { id: tag.id, x, y, yaw: tag.pose.yaw, width: 0.6, depth: 0.4, height: 0.42, flowers: flowersOf(tag).length };
  });
}

function cameraInfo(clockS: number, frame: string): sensor_msgs_CameraInfo {
  const { width, height, focal } = IMAGE;
  return {
    header: header(clockS, frame),
    height,
    width,
    distortion_model: "plumb_bob",
    d: new Float64Array(5),
    k: Float64Array.from([focal, 0, width / 2, 0, focal, height / 2, 0, 0, 1]),
    r: Float64Array.from([1, 0, 0, 0, 1, 0, 0, 0, 1]),
    p: Float64Array.from([focal, 0, width / 2, 0, 0, focal, height / 2, 0, 0, 0, 1, 0]),
    binning_x: 0,
    binning_y: 0,
    roi: { x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false },
  };
}
