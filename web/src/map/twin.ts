/** The tags of the digital twin, as the map and the greenhouse table show them. */
import type { lupin_msgs_TwinState, lupin_msgs_TwinTagState } from "@/generated/messages";
import { type Health, type Reading, type Sensor, SENSORS, assess, compareHealth, inNaturalUnit, isSensor } from "./health";
import type { Point } from "./view";

/** The twin's state is out of date if no message has arrived for this long. */
export const TWIN_STALE_MS = 3000;
/** Times before this are of a clock that was never set, or simulated. */
const FIRST_REAL_S = 1_000_000_000;

export interface Flower {
  x: number;
  y: number;
  z: number;
  heightM: number;
  species: string;
  hasBug: boolean;
}

export interface Tag {
  id: string;
  /** Where the tag is; null while nothing saw it. */
  at: { x: number; y: number; z: number } | null;
  /** The unit vector out of its front on the map; null where it lies flat. */
  normal: Point | null;
  /** In natural units, by sensor. */
  readings: Partial<Record<Sensor, number>>;
  health: Health;
  species: string;
  flowers: Flower[];
  flowerCount: number;
  bugCount: number;
  hasBug: boolean;
  footprint: Point[];
  /** The age in s of its last observation when the message was sent; null where it was never observed. */
  ageS: number | null;
}

/** The tags of a message; those without an id are passed over. */
export function readTwin(message: lupin_msgs_TwinState, wallTimeS: number = Date.now() / 1000): Tag[] {
  const sentS = message.header.stamp.sec + message.header.stamp.nanosec / 1e9;
  return message.tags.filter((tag) => tag.tag_id !== "").map((tag) => readTag(tag, sentS, wallTimeS));
}

function readTag(tag: lupin_msgs_TwinTagState, sentS: number, wallTimeS: number): Tag {
  const { position, orientation } = tag.pose;
  const isPlaced = orientation.w !== 0 && [position.x, position.y].every(Number.isFinite);
  const readings: Reading[] = tag.readings.map(({ name, value }) => ({ name, value: inNaturalUnit(name, value) }));
  return {
    id: tag.tag_id,
    at: isPlaced ? { x: position.x, y: position.y, z: finite(position.z) } : null,
    normal: isPlaced ? normalOf(orientation) : null,
    readings: Object.fromEntries(
      readings.filter(({ name, value }) => isSensor(name) && Number.isFinite(value)).map(({ name, value }) => [name, value]),
    ),
    health: assess(readings),
    species: tag.species,
    flowers: tag.flowers
      .filter((flower) => Number.isFinite(flower.position.x) && Number.isFinite(flower.position.y))
      .map((flower) => ({
        x: flower.position.x,
        y: flower.position.y,
        z: finite(flower.position.z),
        heightM: finite(flower.height_m),
        species: flower.species,
        hasBug: flower.anomaly,
      })),
    flowerCount: tag.flower_count,
    bugCount: tag.bug_count,
    hasBug: tag.anomaly || tag.bug_count > 0,
    footprint: tag.box_footprint.points.filter(({ x, y }) => Number.isFinite(x) && Number.isFinite(y)).map(({ x, y }) => ({ x, y })),
    ageS: ageOf(tag, sentS, wallTimeS),
  };
}

function finite(value: number): number {
  return Number.isFinite(value) ? value : 0;
}

/** The tag's +Z axis, its outward normal, on the map. */
function normalOf({ x, y, z, w }: { x: number; y: number; z: number; w: number }): Point | null {
  const normal = { x: 2 * (x * z + w * y), y: 2 * (y * z - w * x) };
  const length = Math.hypot(normal.x, normal.y);
  return length < 1e-6 || !Number.isFinite(length) ? null : { x: normal.x / length, y: normal.y / length };
}

/**
 * The age from `last_observed` if that is a real time, else from `stale_seconds`. A real time is compared with the message's
 * own stamp if that is real, too, because the robot's clock may differ from this computer's.
 */
function ageOf(tag: lupin_msgs_TwinTagState, sentS: number, wallTimeS: number): number | null {
  const observedS = tag.last_observed.sec + tag.last_observed.nanosec / 1e9;
  if (observedS === 0) return null;
  if (observedS > FIRST_REAL_S) return Math.max(0, (sentS > FIRST_REAL_S ? sentS : wallTimeS) - observedS);
  return Number.isFinite(tag.stale_seconds) ? Math.max(0, tag.stale_seconds) : null;
}

/** Orders numeric ids by number, and before all others. */
export function compareIds(a: string, b: string): number {
  const [isNumberA, isNumberB] = [/^\d+$/.test(a), /^\d+$/.test(b)];
  if (isNumberA && isNumberB) return Number(a) - Number(b);
  if (isNumberA !== isNumberB) return isNumberA ? -1 : 1;
  return a < b ? -1 : a > b ? 1 : 0;
}

export type TagOrder = "health" | "id" | "age";

export function sortTags(tags: readonly Tag[], order: TagOrder): Tag[] {
  return tags.toSorted((a, b) => {
    if (order === "age" && a.ageS !== b.ageS) return (a.ageS ?? Infinity) - (b.ageS ?? Infinity);
    if (order === "health") {
      const byHealth = compareHealth(a.health, b.health) || Number(b.hasBug) - Number(a.hasBug);
      if (byHealth !== 0) return byHealth;
    }
    return compareIds(a.id, b.id);
  });
}

/** The sensors that a tag has a reading of, in the order of the table of ranges. */
export function knownSensors(tag: Tag): Sensor[] {
  return SENSORS.filter((sensor) => tag.readings[sensor] !== undefined);
}
