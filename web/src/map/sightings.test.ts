import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { type lupin_msgs_Observation, lupin_msgs_Observation as OBSERVATION, type nav_msgs_Odometry } from "@/generated/messages";
import { type Change, LiveMap } from "./live_map";
import { SIGHTING_MS, addSighting, placeOf, shownSightings } from "./sightings";

const pose = (x: number, w = 1) => ({ position: { x, y: 2, z: 0 }, orientation: { x: 0, y: 0, z: 0, w } });

function observation(changes: Partial<lupin_msgs_Observation> = {}, stampS = 100): lupin_msgs_Observation {
  return {
    header: { stamp: { sec: stampS, nanosec: 0 }, frame_id: "map" },
    kind: OBSERVATION.KIND_FLOWER,
    status: OBSERVATION.STATUS_OK,
    tag_pose_in_map: pose(1),
    flower: { pose: { pose: pose(5) } },
    ...changes,
  } as lupin_msgs_Observation;
}

describe("the place of an observation", () => {
  it("is its tag's, or that of its flowers where the tag has none", () => {
    expect(placeOf(observation())).toEqual({ x: 1, y: 2 });
    expect(placeOf(observation({ tag_pose_in_map: pose(0, 0) }))).toEqual({ x: 5, y: 2 });
    expect(placeOf(observation({ tag_pose_in_map: pose(NaN) }))).toEqual({ x: 5, y: 2 });
  });

  it.each([
    ["failed", observation({ status: OBSERVATION.STATUS_SCAN_FAILED })],
    ["read a tag without a pose", observation({ kind: OBSERVATION.KIND_TAG_READING, tag_pose_in_map: pose(0, 0) })],
  ])("is unknown where it %s", (_, each) => {
    expect(placeOf(each)).toBeNull();
  });
});

describe("sightings", () => {
  it("are shown for five seconds, once for each place", () => {
    let sightings = addSighting([], { x: 1, y: 2, receivedMs: 0 });
    sightings = addSighting(sightings, { x: 3, y: 2, receivedMs: 1000 });
    sightings = addSighting(sightings, { x: 1, y: 2, receivedMs: 2000 });
    expect(sightings).toHaveLength(2);
    expect(shownSightings(sightings, 2000 + SIGHTING_MS)).toEqual([{ x: 1, y: 2, receivedMs: 2000 }]);
    expect(shownSightings(sightings, 2001 + SIGHTING_MS)).toEqual([]);
    expect(shownSightings(sightings, 500)).toEqual([]);
    expect(addSighting(sightings, { x: 9, y: 9, receivedMs: 60_000 })).toHaveLength(1);
  });
});

describe("the live map's sightings", () => {
  beforeEach(() => vi.useFakeTimers());
  afterEach(() => vi.useRealTimers());

  it("are of now, and go by themselves", () => {
    const map = new LiveMap();
    const changes: Change[] = [];
    map.takeObservation(observation(), 0);
    expect(map.sightings).toEqual([]);

    map.follow("odom", "base_link");
    const odometry = { header: { stamp: { sec: 103, nanosec: 0 }, frame_id: "odom" }, child_frame_id: "base_link", pose: { pose: pose(0) } };
    map.takeOdometry({ ...odometry, twist: { twist: { linear: { x: 0, y: 0, z: 0 } } } } as nav_msgs_Odometry, 0);
    map.listen((change) => changes.push(change));
    map.takeObservation(observation({}, 90), 0);
    expect(map.sightings).toEqual([]);
    map.takeObservation(observation({}, 100), 0);
    map.takeObservation(observation({ status: OBSERVATION.STATUS_SKIPPED }, 102), 0);
    expect(map.sightings).toEqual([{ x: 1, y: 2, receivedMs: 0 }]);
    expect(changes).toEqual(["motion"]);
    vi.advanceTimersByTime(SIGHTING_MS + 2);
    expect(changes).toEqual(["motion", "motion"]);
    map.forget();
    expect(map.sightings).toEqual([]);
  });
});
