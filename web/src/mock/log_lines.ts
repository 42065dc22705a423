/** The mock log of the graph. */
import { type rcl_interfaces_Log as Log, rcl_interfaces_Log as LEVELS } from "@/generated/messages";
import { time } from "./messages";
import type { World } from "./world";

type Line = readonly [level: number, node: string, text: string];

const LINES: readonly Line[] = [
  [LEVELS.INFO, "navigator", "goal accepted: (1.83, 0.77)"],
  [LEVELS.DEBUG, "slam_toolbox", "scan added, 41 in the graph"],
  [LEVELS.INFO, "tag_annotator", "tag 19 at 0.62 m"],
  [LEVELS.WARN, "navigator", "what the lidar shows is 0.31 s old; driving at 63 % of the speed"],
  [LEVELS.INFO, "greenhouse_bridge", "tag 5: temperature 14.6 °C, soil_moisture 28.1 %"],
  [LEVELS.INFO, "perception_aggregator", "tag 3: tulip_red, 2 flowers, 1 bug"],
  [LEVELS.WARN, "lupin_console", "phone-2 was disconnected: it took no image for 10 s"],
  [LEVELS.DEBUG, "twist_mux", "nav drives"],
  [LEVELS.ERROR, "gripper_camera", "the camera did not deliver an image for 2.0 s"],
  [LEVELS.INFO, "lupin_twin", "8 tags, 6 of them with flowers"],
  [LEVELS.INFO, "mission_orchestrator", "INSPECTING: next tag 22"],
  [LEVELS.FATAL, "arm_calibrate_server", "no servo driver; it ends"],
];

/** How many lines a flood has at each sample, at half a sample a second. */
const FLOOD = 20_000;

let count = 0;

export function logLines(world: World): Log[] {
  if (world.options.faults.has("logs")) return Array.from({ length: FLOOD }, (_, index) => logLine(world, index, `line ${index} of a flood`));
  count += 1;
  return [logLine(world, count)];
}

function logLine({ clockS }: World, index: number, flood?: string): Log {
  const [level, name, text] = LINES[index % LINES.length] ?? [LEVELS.INFO, "", ""];
  return { stamp: time(clockS), level, name, msg: flood ?? text, file: `${name}.py`, function: "run", line: 40 + index % 50 };
}
