/** The seven tabs, in their order. */
import { Bot, Camera, ChartLine, Gamepad2, Map as MapIcon, Mic, ScrollText } from "lucide-react";
import type { ComponentType } from "react";
import type { TextKey } from "@/i18n/text";
import { deferred } from "@/ui/deferred";

export type TabId = "teleop" | "arm" | "voice" | "cameras" | "telemetry" | "logs" | "map";

export interface Tab {
  id: TabId;
  number: string;
  label: TextKey;
  icon: ComponentType<{ className?: string }>;
  view: ComponentType;
}

export const TABS: readonly Tab[] = [
  { id: "teleop", number: "01", label: "tab_teleop", icon: Gamepad2, view: deferred(() => import("./teleop/teleop_tab")) },
  { id: "arm", number: "02", label: "tab_arm", icon: Bot, view: deferred(() => import("./arm/arm_tab")) },
  { id: "voice", number: "03", label: "tab_voice", icon: Mic, view: deferred(() => import("./voice/voice_tab")) },
  { id: "cameras", number: "04", label: "tab_cameras", icon: Camera, view: deferred(() => import("./cameras/cameras_tab")) },
  { id: "telemetry", number: "05", label: "tab_telemetry", icon: ChartLine, view: deferred(() => import("./telemetry/telemetry_tab")) },
  { id: "logs", number: "06", label: "tab_logs", icon: ScrollText, view: deferred(() => import("./logs/logs_tab")) },
  { id: "map", number: "07", label: "tab_map", icon: MapIcon, view: deferred(() => import("./map/map_tab")) },
];
