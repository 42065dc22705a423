/** The settings in the order and groups in which the drawer shows them. */
import type { TextKey } from "@/i18n/text";
import { type SettingName, type SettingRow, isValid } from "@/state/settings";

export interface Group {
  title: TextKey;
  names: readonly SettingName[];
  /** Whether the group is closed at first, because few people change its settings. */
  folded?: boolean;
}

export const GROUPS: readonly Group[] = [
  { title: "settings_look", names: ["theme", "surfaceContrast", "reduceTransparency"] },
  { title: "settings_driving", names: ["estopAutoOnFocusLoss", "speedScale", "polarityInvertHmi"] },
  { title: "settings_arm", names: ["armRateDegPerSec", "armServoNamespace"], folded: true },
  {
    title: "settings_voice",
    names: [
      "voiceEngine",
      "voiceLanguage",
      "voicePushToTalk",
      "voiceVadEnabled",
      "voiceVadEndHoldMs",
      "voiceVadMaxUtteranceMs",
      "voiceVadStartThreshold",
      "voiceVadEndThreshold",
      "voiceMaxLinearMps",
      "voiceMaxAngularRps",
      "geminiModel",
      "voiceSystemPrompt",
    ],
    folded: true,
  },
  {
    title: "settings_topics",
    names: [
      "cmdVelTopic",
      "cmdVelType",
      "cameraTopic",
      "scanTopic",
      "odomTopic",
      "imuTopic",
      "batteryTopic",
      "jointStatesTopic",
      "rosoutTopic",
      "mapTopic",
      "planTopic",
      "goalPoseTopic",
      "rosUrl",
      "webVideoServerUrl",
      "mapFrame",
      "baseFrame",
    ],
    folded: true,
  },
  { title: "settings_diagnosis", names: ["debugPublish"] },
];

/** The number that a person typed, within a setting's range; null if it is none. Times in ms are whole. */
export function readNumber(text: string, row: SettingRow): number | null {
  const value = Number(text.trim().replace(",", "."));
  return text.trim() !== "" && isValid(value, row) ? value : null;
}
