/** Which fields are plotted, and how. It outlives the tab; the samples do not. */
import { create } from "zustand";
import { JOINTS, TOPICS } from "@/generated/graph";
import { currentSettings } from "@/state/settings";

export interface PlotField {
  topic: string;
  type: string;
  path: string;
}

export interface PlotSeries extends PlotField {
  id: string;
  /** Its index in the palette. */
  style: number;
}

export type PlotMode = "together" | "stacked";
export const WINDOWS_S = [30, 60, 300] as const;
export const LONGEST_S = 300;
export const MAX_SERIES = 8;

interface PlotState {
  series: PlotSeries[];
  mode: PlotMode;
  windowS: number;
}

export const usePlots = create<PlotState>(() => ({ series: [], mode: "stacked", windowS: 60 }));

export function addSeries(fields: readonly PlotField[]): void {
  usePlots.setState(({ series }) => {
    const all = [...series];
    for (const field of fields) {
      const id = `${field.topic} ${field.path}`;
      if (all.length >= MAX_SERIES || all.some((each) => each.id === id)) continue;
      all.push({ ...field, id, style: freeStyle(all) });
    }
    return { series: all };
  });
}

export function removeSeries(id: string): void {
  usePlots.setState(({ series }) => ({ series: series.filter((each) => each.id !== id) }));
}

function freeStyle(series: readonly PlotSeries[]): number {
  const used = new Set(series.map(({ style }) => style));
  for (let style = 0; style < MAX_SERIES; style += 1) if (!used.has(style)) return style;
  return 0;
}

/** Color tokens and dash patterns, so that two lines differ in more than their color. */
export const STYLES: readonly { color: string; dash: readonly number[] }[] = [
  { color: "--color-sensed", dash: [] },
  { color: "--color-alive", dash: [] },
  { color: "--color-text", dash: [] },
  { color: "--color-attention", dash: [] },
  { color: "--color-sensed", dash: [8, 5] },
  { color: "--color-alive", dash: [8, 5] },
  { color: "--color-text", dash: [8, 5] },
  { color: "--color-attention", dash: [8, 5] },
];

export type StarterName = "speed" | "turn" | "voltage" | "arm";

/** Sets of fields that are often plotted, on the topics of the settings. */
export function starterFields(name: StarterName): PlotField[] {
  const { odomTopic, imuTopic, batteryTopic, cmdVelTopic, jointStatesTopic } = currentSettings();
  const odometry = { topic: odomTopic, type: TOPICS.ODOM.type };
  switch (name) {
    case "speed":
      return [
        { ...odometry, path: "twist.twist.linear.x" },
        { ...odometry, path: "twist.twist.linear.y" },
        { topic: cmdVelTopic, type: TOPICS.CMD_VEL_MANUAL.type, path: "linear.x" },
      ];
    case "turn":
      return [
        { topic: imuTopic, type: TOPICS.IMU.type, path: "angular_velocity.z" },
        { ...odometry, path: "twist.twist.angular.z" },
      ];
    case "voltage":
      return [
        { topic: batteryTopic, type: TOPICS.BATTERY.type, path: "voltage" },
        { topic: batteryTopic, type: TOPICS.BATTERY.type, path: "current" },
      ];
    case "arm":
      return JOINTS.arm.map((joint) => ({ topic: jointStatesTopic, type: TOPICS.JOINT_STATES.type, path: `position[${joint}]` }));
  }
}

/** Types whose messages are too large to be sent to a browser for a single number. */
const HEAVY_TYPES = ["sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/PointCloud2", "nav_msgs/msg/OccupancyGrid"];

/** Topics whose fields can be plotted, by name: those of the graph's table, and those that exist. */
export function plottableTopics(found: { topics: readonly string[]; types: readonly string[] } | null): { name: string; type: string }[] {
  const types = new Map<string, string>(Object.values(TOPICS).map(({ name, type }) => [name, type]));
  for (const [index, name] of (found?.topics ?? []).entries()) {
    const type = found?.types[index];
    if (type !== undefined && type !== "") types.set(name, type);
  }
  const exists = new Set(found?.topics ?? []);
  return [...types]
    .filter(([name, type]) => !HEAVY_TYPES.includes(type) && (found === null || exists.has(name)))
    .map(([name, type]) => ({ name, type }))
    .toSorted((a, b) => a.name.localeCompare(b.name));
}
