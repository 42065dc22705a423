/** The data of the mock greenhouse's tags: readings, flowers, and the fields interpolated between them. */
import {
  type lupin_msgs_DiscoveredTags,
  type lupin_msgs_FlowerPoint,
  type lupin_msgs_GetField_Request,
  type lupin_msgs_GetField_Response,
  lupin_msgs_Observation as KINDS,
  type lupin_msgs_Observation,
  type lupin_msgs_SensorReading,
  type lupin_msgs_TagReading,
  type lupin_msgs_TwinState,
} from "@/generated/messages";
import { type Tag, TAGS, boxOf, flowersOf } from "./greenhouse";
import { NO_POSE, header, noise, pose, poseStamped, time } from "./messages";
import { PUBLISHING_S } from "./mission_loop";
import type { World } from "./world";

/** A field is interpolated up to this distance from a reading. */
const FIELD_REACH_M = 1.6;
const CELL_M = 0.25;

/** The readings of a tag as they were when it was read last. */
export function readingsOf(tag: Tag, readS: number): lupin_msgs_SensorReading[] {
  return Object.entries(tag.readings).map(([name, base], index) => ({
    name,
    value: Number((base * (1 + 0.012 * noise(Math.floor(readS) + index))).toFixed(1)),
  }));
}

function flowerPoints(tag: Tag): lupin_msgs_FlowerPoint[] {
  return flowersOf(tag).map(({ x, y, heightM, species, bug }) => ({
    position: { x, y, z: heightM },
    height_m: heightM - 0.42,
    species,
    confidence: 0.91,
    anomaly: bug,
  }));
}

function footprint(tag: Tag): { points: { x: number; y: number; z: number }[] } {
  return { points: boxOf(tag).map(({ x, y }) => ({ x, y, z: 0 })) };
}

export function twinState(world: World): lupin_msgs_TwinState {
  const { clockS, timeS, readS } = world;
  return {
    header: header(clockS, "map"),
    tags: TAGS.map((tag) => {
      const at = readS.get(tag.id) ?? 0;
      return {
        tag_id: tag.id,
        pose: pose(tag.pose, 0.24),
        readings: readingsOf(tag, at),
        last_observed: time(clockS - (timeS - at)),
        stale_seconds: timeS - at,
        species: tag.species,
        species_confidence: tag.species === "" ? 0 : 0.93,
        anomaly: tag.bugs > 0,
        flower_count: tag.flowers,
        bug_count: tag.bugs,
        flowers: flowerPoints(tag),
        box_footprint: footprint(tag),
      };
    }),
  };
}

export function discoveredTags({ clockS, timeS }: World): lupin_msgs_DiscoveredTags {
  return {
    header: header(clockS, "map"),
    tags: TAGS.map((tag, index) => ({
      tag_id: tag.id,
      pose_in_map: pose(tag.pose, 0.24),
      species: tag.species,
      species_confidence: tag.species === "" ? 0 : 0.93,
      anomaly: tag.bugs > 0,
      sightings: 12 + 7 * index + Math.floor(timeS / 10),
    })),
  };
}

export function tagReading(tag: Tag, world: World): lupin_msgs_TagReading {
  return {
    tag_id: tag.id,
    stamp: time(world.clockS),
    sim_time_of_day_seconds: (36_000 + world.timeS) % 86_400,
    readings: readingsOf(tag, world.timeS),
  };
}

/** What is observed while a tag is read: its reading, and its flowers in turn. */
export function observation(world: World): lupin_msgs_Observation | null {
  const { mission, clockS } = world;
  const target = mission.target;
  const tag = target === null || target.index === null ? undefined : TAGS[target.index];
  if (tag === undefined || !["scanning", "publishing"].includes(mission.loop.phase) || mission.paused) return null;
  const isReading = mission.loop.phase === "publishing";
  const mapPose = { header: header(clockS, "map"), pose: pose(tag.pose, 0.24) };
  // A reading is repeated with the stamp at which it was taken, as a latched topic repeats it.
  const takenS = isReading ? Math.round((clockS - mission.loop.progress * PUBLISHING_S) * 100) / 100 : clockS;
  return {
    header: header(takenS, "map"),
    mission_id: "lupin-5ca1ab1e",
    source: isReading ? "InspectionMission" : "perception_aggregator",
    kind: isReading ? KINDS.KIND_TAG_READING : KINDS.KIND_FLOWER,
    status: KINDS.STATUS_OK,
    status_detail: "",
    tag_reading: isReading ? tagReading(tag, world) : { tag_id: "", stamp: time(0), sim_time_of_day_seconds: 0, readings: [] },
    flower: {
      tag_id: tag.id,
      pose: mapPose,
      species: tag.species,
      confidence: tag.species === "" ? 0 : 0.93,
      anomaly: tag.bugs > 0,
      flower_count: tag.flowers,
      bug_count: tag.bugs,
      flowers: flowerPoints(tag),
      box_footprint: footprint(tag),
    },
    anomaly: { pose: poseStamped(0, "map", { x: 0, y: 0, yaw: 0 }), description: "", severity: 0 },
    tag_pose_in_map: isReading ? pose(tag.pose, 0.24) : NO_POSE,
  };
}

/** The field of a sensor, by the inverse distance to the tags that measured it; NaN where none is near. */
export function field(request: Partial<lupin_msgs_GetField_Request>, world: World): lupin_msgs_GetField_Response {
  const sensor = request.sensor_type ?? "";
  const measured = TAGS.flatMap((tag) => {
    const value = readingsOf(tag, world.readS.get(tag.id) ?? 0).find(({ name }) => name === sensor)?.value;
    return value === undefined ? [] : [{ x: tag.pose.x, y: tag.pose.y, value }];
  });
  const resolution = Math.max(0.05, request.resolution || CELL_M);
  const [left, bottom] = [request.bbox_min_x ?? -4.2, request.bbox_min_y ?? -2.8];
  const width = Math.max(1, Math.round(((request.bbox_max_x ?? 4.2) - left) / resolution));
  const height = Math.max(1, Math.round(((request.bbox_max_y ?? 2.8) - bottom) / resolution));
  const values = new Float32Array(width * height);
  for (let row = 0; row < height; row += 1) {
    for (let column = 0; column < width; column += 1) {
      values[row * width + column] = interpolate(measured, left + (column + 0.5) * resolution, bottom + (row + 0.5) * resolution);
    }
  }
  const known = measured.map(({ value }) => value);
  return {
    ok: measured.length > 0,
    error_message: measured.length > 0 ? "" : `no tag has measured '${sensor}'`,
    values,
    width,
    height,
    origin_x: left,
    origin_y: bottom,
    resolution_used: resolution,
    value_min: known.length > 0 ? Math.min(...known) : NaN,
    value_max: known.length > 0 ? Math.max(...known) : NaN,
    sample_count: measured.length,
  };
}

function interpolate(measured: readonly { x: number; y: number; value: number }[], x: number, y: number): number {
  let weights = 0;
  let sum = 0;
  for (const sample of measured) {
    const distance = Math.hypot(sample.x - x, sample.y - y);
    if (distance > FIELD_REACH_M) continue;
    const weight = 1 / (0.05 + distance * distance);
    weights += weight;
    sum += weight * sample.value;
  }
  return weights > 0 ? sum / weights : NaN;
}
