/** Every text in English: what the keys are, and what is shown in place of a language that could not be loaded. */
import { arm } from "./en/arm";
import { boot } from "./en/boot";
import { cameras } from "./en/cameras";
import { doctor } from "./en/doctor";
import { logs } from "./en/logs";
import { map } from "./en/map";
import { mission } from "./en/mission";
import { palette } from "./en/palette";
import { places } from "./en/places";
import { rewind } from "./en/rewind";
import { runs } from "./en/runs";
import { settings } from "./en/settings";
import { shell } from "./en/shell";
import { stop } from "./en/stop";
import { telemetry } from "./en/telemetry";
import { teleop } from "./en/teleop";
import { voice } from "./en/voice";

export const texts = {
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

export type TextKey = keyof typeof texts;
