/** Every text in Dutch, and what the robot and the console say. */
import type { TextKey } from "./english";
import { arm } from "./nl/arm";
import { boot } from "./nl/boot";
import { cameras } from "./nl/cameras";
import { doctor } from "./nl/doctor";
import { logs } from "./nl/logs";
import { map } from "./nl/map";
import { mission } from "./nl/mission";
import { palette } from "./nl/palette";
import { places } from "./nl/places";
import { rewind } from "./nl/rewind";
import { runs } from "./nl/runs";
import { settings } from "./nl/settings";
import { shell } from "./nl/shell";
import { stop } from "./nl/stop";
import { telemetry } from "./nl/telemetry";
import { teleop } from "./nl/teleop";
import { voice } from "./nl/voice";

export { sentences } from "./nl/sentences";

export const texts: Record<TextKey, string> = {
  ...arm,
  ...boot,
  ...cameras,
  ...doctor,
  ...logs,
  ...map,
  ...mission,
  ...palette,
  ...places,
  ...rewind,
  ...runs,
  ...settings,
  ...shell,
  ...stop,
  ...telemetry,
  ...teleop,
  ...voice,
};
