import { describe, expect, it } from "vitest";
import type { lupin_msgs_TwinState, lupin_msgs_TwinTagState } from "@/generated/messages";
import { compareIds, knownSensors, readTwin, sortTags } from "./twin";

function tag(id: string, changes: Partial<lupin_msgs_TwinTagState> = {}): lupin_msgs_TwinTagState {
  return {
    tag_id: id,
    pose: { position: { x: 1, y: 2, z: 0.2 }, orientation: { x: 0, y: 0, z: 0, w: 1 } },
    readings: [],
    last_observed: { sec: 0, nanosec: 0 },
    stale_seconds: 0,
    species: "",
    species_confidence: 0,
    anomaly: false,
    flower_count: 0,
    bug_count: 0,
    flowers: [],
    box_footprint: { points: [] },
    ...changes,
  };
}

function twin(tags: lupin_msgs_TwinTagState[], sec = 500): lupin_msgs_TwinState {
  return { header: { stamp: { sec, nanosec: 0 }, frame_id: "map" }, tags };
}

describe("the twin", () => {
  it("is empty at first", () => {
    expect(readTwin(twin([]))).toEqual([]);
    expect(readTwin(twin([tag("")]))).toEqual([]);
  });

  it("has no pin for a tag that nothing saw", () => {
    const pose = { position: { x: 0, y: 0, z: 0 }, orientation: { x: 0, y: 0, z: 0, w: 0 } };
    expect(readTwin(twin([tag("1", { pose })]))[0]?.at).toBeNull();
    const broken = { position: { x: NaN, y: 0, z: 0 }, orientation: { x: 0, y: 0, z: 0, w: 1 } };
    expect(readTwin(twin([tag("1", { pose: broken })]))[0]?.at).toBeNull();
  });

  it("knows where a tag looks", () => {
    // Upright, looking along +x: the tag's z axis turned from up to forward.
    const half = Math.SQRT1_2;
    const pose = { position: { x: 0, y: 0, z: 0.2 }, orientation: { x: 0, y: half, z: 0, w: half } };
    const normal = readTwin(twin([tag("1", { pose })]))[0]?.normal;
    expect(normal?.x).toBeCloseTo(1);
    expect(normal?.y).toBeCloseTo(0);
    expect(readTwin(twin([tag("1")]))[0]?.normal).toBeNull();
  });

  it("takes ages from real times by the robot's own clock, else from stale_seconds", () => {
    const simulated = tag("1", { last_observed: { sec: 400, nanosec: 0 }, stale_seconds: 12 });
    expect(readTwin(twin([simulated]))[0]?.ageS).toBe(12);
    const real = tag("1", { last_observed: { sec: 1_700_000_000, nanosec: 0 }, stale_seconds: 3 });
    expect(readTwin(twin([real], 1_700_000_030))[0]?.ageS).toBe(30);
    expect(readTwin(twin([real], 0), 1_700_000_050)[0]?.ageS).toBe(50);
    expect(readTwin(twin([tag("1", { stale_seconds: 7 })]))[0]?.ageS).toBeNull();
    expect(readTwin(twin([{ ...simulated, stale_seconds: NaN }]))[0]?.ageS).toBeNull();
  });

  it("leaves out readings that are not numbers", () => {
    const readings = [{ name: "soil_moisture", value: 0.4 }, { name: "light", value: NaN }, { name: "wind", value: 1 }];
    const [found] = readTwin(twin([tag("1", { readings })]));
    expect(found?.readings).toEqual({ soil_moisture: 40 });
    expect(knownSensors(found!)).toEqual(["soil_moisture"]);
  });

  it("sorts by health, bugs, age and id", () => {
    const tags = readTwin(
      twin([
        tag("10", { last_observed: { sec: 1, nanosec: 0 }, stale_seconds: 5 }),
        tag("9", { readings: [{ name: "light", value: 300 }] }),
        tag("2", { readings: [{ name: "light", value: 300 }], anomaly: true }),
        tag("a", { readings: [{ name: "light", value: 9000 }] }),
      ]),
    );
    expect(sortTags(tags, "health").map(({ id }) => id)).toEqual(["a", "2", "9", "10"]);
    expect(sortTags(tags, "id").map(({ id }) => id)).toEqual(["2", "9", "10", "a"]);
    expect(sortTags(tags, "age").map(({ id }) => id)).toEqual(["10", "2", "9", "a"]);
    expect(compareIds("b", "a")).toBe(1);
    expect(compareIds("1", "1")).toBe(0);
  });
});
