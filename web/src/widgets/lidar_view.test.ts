// @vitest-environment jsdom
import { describe, expect, it } from "vitest";
import type { sensor_msgs_LaserScan } from "@/generated/messages";
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

describe("the scan", () => {
  it("starts at the robot's left, where the lidar's zero points", () => {
    const [first] = echoes(scan([1]));
    expect(first?.x).toBeCloseTo(0, 2);
    expect(first?.y).toBeCloseTo(1, 2);
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
