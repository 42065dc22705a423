/** The settings in the order and groups in which the drawer shows them. */
import { SETTINGS, type Settings } from "@/generated/settings";
import type { TextKey } from "@/i18n/text";

export type SettingName = keyof Settings;

export interface Group {
  title: TextKey;
  names: readonly SettingName[];
  /** Shut until it is opened: what few people change. */
  folded?: boolean;
}

export const GROUPS: readonly Group[] = [
  { title: "settings_look", names: ["theme", "surfaceContrast", "reduceTransparency"] },
  { title: "settings_driving", names: ["estopAutoOnFocusLoss", "speedScale", "polarityInvertHmi"] },
  { title: "settings_arm", names: ["armRateDegPerSec", "armServoNamespace"], folded: true },
  {
    title: "settings_voice",
    names: [
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
      "mapFrame",
      "baseFrame",
    ],
    folded: true,
  },
  { title: "settings_diagnosis", names: ["debugPublish"] },
];

export interface SettingRow {
  default: boolean | number | string;
  unit: string;
  low?: number;
  high?: number;
  choices?: readonly string[];
}

export function rowOf(name: SettingName): SettingRow {
  return SETTINGS[name];
}

/** The number that a person typed, within a setting's range; null where it is none. Times in ms are whole. */
export function readNumber(text: string, { low = -Infinity, high = Infinity, unit }: SettingRow): number | null {
  const value = Number(text.trim().replace(",", "."));
  if (text.trim() === "" || !Number.isFinite(value) || value < low || value > high) return null;
  return unit === "ms" && !Number.isInteger(value) ? null : value;
}
