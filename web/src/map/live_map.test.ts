import { describe, expect, it } from "vitest";
import type { nav_msgs_Odometry, sensor_msgs_LaserScan, tf2_msgs_TFMessage } from "@/generated/messages";
import { gridMessage } from "./grid_fixture";
import { type Change, LiveMap } from "./live_map";

function header(frame_id: string, stampS: number) {
  return { stamp: { sec: Math.floor(stampS), nanosec: Math.round((stampS % 1) * 1e9) }, frame_id };
}

function transform(parent: string, child: string, x: number, stampS: number, yaw = 0): tf2_msgs_TFMessage["transforms"][number] {
  const rotation = { x: 0, y: 0, z: Math.sin(yaw / 2), w: Math.cos(yaw / 2) };
  return { header: header(parent, stampS), child_frame_id: child, transform: { translation: { x, y: 0, z: 0 }, rotation } };
}

function odometry(x: number, stampS: number): nav_msgs_Odometry {
  const pose = { position: { x, y: 0, z: 0 }, orientation: { x: 0, y: 0, z: 0, w: 1 } };
  const twist = { linear: { x: 0.3, y: 0.4, z: 0 }, angular: { x: 0, y: 0, z: 0 } };
  return { header: header("odom", stampS), child_frame_id: "base_link", pose: { pose }, twist: { twist } } as unknown as nav_msgs_Odometry;
}

function scan(stampS: number): sensor_msgs_LaserScan {
  return {
    header: header("laser", stampS),
    angle_min: 0,
    angle_increment: Math.PI / 2,
    range_min: 0.1,
    range_max: 5,
    ranges: Float32Array.from([2, NaN, 0, 9]),
  } as sensor_msgs_LaserScan;
}

function started(): { map: LiveMap; changes: Change[] } {
  const map = new LiveMap();
  const changes: Change[] = [];
  map.listen((change) => changes.push(change));
  map.takeTransforms({ transforms: [transform("map", "odom", 10, 1), transform("base_link", "laser", 0, 1, Math.PI / 2)] }, 0);
  return { map, changes };
}

describe("the live map", () => {
  it("has no pose before the chain of transforms is whole", () => {
    const { map, changes } = started();
    expect(map.pose).toBeNull();
    map.takeTransforms({ transforms: [transform("odom", "base_link", 1, 1)] }, 5);
    expect(map.pose?.x).toBe(11);
    expect(map.poseReceivedMs).toBe(5);
    expect(changes).toEqual(["motion"]);
  });

  it("does not know the place any more once the transforms from the map have ended", () => {
    const { map } = started();
    map.takeOdometry(odometry(1, 1), 4900);
    expect(map.poseReceivedMs).toBe(4900);
    map.takeOdometry(odometry(2, 6), 5100);
    expect([map.poseReceivedMs, map.pose?.x]).toEqual([4900, 11]);
    map.takeTransforms({ transforms: [transform("map", "odom", 10, 7)] }, 9000);
    map.takeOdometry(odometry(2, 8), 9100);
    expect([map.poseReceivedMs, map.pose?.x]).toEqual([9100, 12]);
  });

  it("believes a static transform from the map for ever", () => {
    const map = new LiveMap();
    map.takeStaticTransforms({ transforms: [transform("map", "odom", 10, 1)] }, 0);
    map.takeOdometry(odometry(2, 99), 99_000);
    expect([map.poseReceivedMs, map.pose?.x]).toEqual([99_000, 12]);
  });

  it("redraws only above 5 mm, and follows the odometry between transforms", () => {
    const { map, changes } = started();
    map.takeOdometry(odometry(1, 1), 1);
    map.takeOdometry(odometry(1.004, 1.1), 2);
    expect(changes.length).toBe(1);
    map.takeOdometry(odometry(1.1, 1.2), 3);
    expect(map.pose?.x).toBeCloseTo(11.1);
    expect(map.speedMps).toBeCloseTo(0.5);
    expect(map.trail.points.length).toBe(2);
  });

  it("passes over transforms that come late, but not a clock that was set back", () => {
    const { map } = started();
    map.takeOdometry(odometry(1, 5), 1);
    map.takeTransforms({ transforms: [transform("odom", "base_link", 0.5, 4.9)] }, 2);
    expect(map.pose?.x).toBe(11);
    map.takeOdometry(odometry(3, 0.1), 3);
    expect(map.pose?.x).toBe(13);
  });

  it("draws a scan from where it was taken", () => {
    const { map } = started();
    map.takeScan(scan(1), 0);
    expect(map.scan).toBeNull();
    map.takeOdometry(odometry(0, 1), 1);
    map.takeOdometry(odometry(1, 2), 2);
    map.takeScan(scan(1.5), 3);
    expect(map.scan?.from.x).toBeCloseTo(10.5);
    expect(map.scan?.echoes.length).toBe(2);
    expect(map.scan?.echoes[1]).toBeCloseTo(2);
    map.takeScan(scan(2.5), 4);
    expect(map.scan?.from.x).toBeCloseTo(10.5);
    map.takeOdometry(odometry(2, 3), 5);
    expect(map.scan?.from.x).toBeCloseTo(11.5);
  });

  it("takes a grid again only when it changed", () => {
    const { map, changes } = started();
    map.takeGrid(gridMessage(["..", ".#"]), 1);
    map.takeGrid(gridMessage(["..", ".#"]), 2);
    map.takeGrid(gridMessage([]), 3);
    expect(map.grid).toMatchObject({ version: 1, receivedMs: 2 });
    expect(changes).toEqual(["scene"]);
    map.takeGrid(gridMessage(["...", ".#."]), 4);
    expect(map.grid?.version).toBe(2);
  });

  it("keeps the last good position of every joint", () => {
    const { map } = started();
    map.takeJoints(["a", "b"], [1, NaN], 1);
    map.takeJoints(["b"], [], 2);
    expect([...map.joints]).toEqual([["a", 1]]);
    expect(map.jointsReceivedMs).toBe(2);
  });

  it("survives empty messages", () => {
    const { map } = started();
    map.takeTransforms({ transforms: [] }, 1);
    map.takePlan({ header: header("map", 1), poses: [] }, 1);
    expect(map.plan?.points).toEqual([]);
    map.forgetTransforms();
    expect(map.pose).toBeNull();
  });
});
