// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import type { sensor_msgs_LaserScan } from "@/generated/messages";
import { MODEL_MOUNT, mountOf } from "@/ros/scan";
import { echoes, nearest } from "./lidar_view";

const scan = (ranges: number[]): sensor_msgs_LaserScan => ({
  header: { stamp: { sec: 0, nanosec: 0 }, frame_id: "laser" },
  angle_min: 0,
  angle_max: 2 * Math.PI,
  angle_increment: Math.PI / 2,
  time_increment: 0,
  scan_time: 0.1,
  range_min: 0.05,
  range_max: 12,
  ranges: new Float32Array(ranges),
  intensities: new Float32Array(),
});

/** A roll, then a yaw. */
function turned(yaw: number, roll: number) {
  const [cy, sy, cr, sr] = [Math.cos(yaw / 2), Math.sin(yaw / 2), Math.cos(roll / 2), Math.sin(roll / 2)];
  return { x: cy * sr, y: sy * sr, z: sy * cr, w: cy * cr };
}

describe("the scan", () => {
  it("starts at the robot's left, where the lidar's zero points", () => {
    const [first] = echoes(scan([1]));
    expect(first?.x).toBeCloseTo(0, 2);
    expect(first?.y).toBeCloseTo(1, 2);
  });

  it("is that of an upright lidar where it hangs upside down, and none where it is tilted", () => {
    const quarter = Math.PI / 4;
    const upright = echoes(scan([1, 2, 3, 4]), { x: 0.1, y: 0, yaw: 0.3, upsideDown: false });
    const hanging = { ...scan([1, 4, 3, 2]), angle_min: 0 };
    const rolled = mountOf({ translation: { x: 0.1, y: 0, z: 0.2 }, rotation: turned(0.3, Math.PI) });
    expect(rolled?.upsideDown).toBe(true);
    const found = echoes(hanging, rolled ?? MODEL_MOUNT);
    for (const [at, of] of [0, 3, 2, 1].entries()) {
      expect(found[at]?.x).toBeCloseTo(upright[of]?.x ?? NaN);
      expect(found[at]?.y).toBeCloseTo(upright[of]?.y ?? NaN);
    }
    expect(mountOf({ translation: { x: 0, y: 0, z: 0 }, rotation: turned(0, quarter) })).toBeNull();
  });

  it("has echoes where the driver states no limit", () => {
    for (const range_max of [0, Infinity]) expect(echoes({ ...scan([1, 0, Infinity]), range_min: 0, range_max })).toHaveLength(1);
  });

  it("leaves out rays without an echo", () => {
    expect(echoes(scan([NaN, Infinity, 0, 13]))).toEqual([]);
    expect(nearest([])).toBeNull();
  });

  it("measures from the robot's outline", () => {
    expect(nearest([{ x: 1, y: 0 }])).toBeCloseTo(0.78, 2);
    expect(nearest([{ x: 0.1, y: 0 }])).toBe(0);
  });
});
