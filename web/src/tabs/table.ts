/** What each tab shows, and how the tab bar and the palette name it. */
import { Bot, Camera, ChartLine, Gamepad2, Map as MapIcon, Mic, ScrollText } from "lucide-react";
import type { ComponentType } from "react";
import type { TextKey } from "@/i18n/text";
import { TAB_IDS, type TabId } from "@/state/tab_ids";
import { deferred } from "@/ui/deferred";

interface Row {
  label: TextKey;
  icon: ComponentType<{ className?: string }>;
  view: ComponentType;
}

const ROWS: Record<TabId, Row> = {
  teleop: { label: "tab_teleop", icon: Gamepad2, view: deferred(() => import("./teleop/teleop_tab")) },
  arm: { label: "tab_arm", icon: Bot, view: deferred(() => import("./arm/arm_tab")) },
  voice: { label: "tab_voice", icon: Mic, view: deferred(() => import("./voice/voice_tab")) },
  cameras: { label: "tab_cameras", icon: Camera, view: deferred(() => import("./cameras/cameras_tab")) },
  telemetry: { label: "tab_telemetry", icon: ChartLine, view: deferred(() => import("./telemetry/telemetry_tab")) },
  logs: { label: "tab_logs", icon: ScrollText, view: deferred(() => import("./logs/logs_tab")) },
  map: { label: "tab_map", icon: MapIcon, view: deferred(() => import("./map/map_tab")) },
};

export interface Tab extends Row {
  id: TabId;
  /** Two digits, as the tab bar shows them. */
  number: string;
}

export const TABS: readonly Tab[] = TAB_IDS.map((id, index) => ({ id, number: String(index + 1).padStart(2, "0"), ...ROWS[id] }));
