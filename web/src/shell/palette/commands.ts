/** The commands of the palette, and which of them can be given now. */
import type { Location } from "@/api/console_store";
import { ARM_PRESETS, LED_COLORS } from "@/generated/robot";
import { LANGUAGES, type Language, type TextKey, type TextValues } from "@/i18n/text";
import { ENDS, type MissionAction, type MissionFacts, refusal } from "@/map/mission_rules";
import { isActive } from "@/state/sentence";
import type { Reason } from "@/state/can_drive";
import type { TabId } from "@/state/tab_ids";
import type { OverlayName } from "@/state/overlays";
import { TABS } from "@/tabs/table";

export type MissionCall = "pause" | "resume" | "skip" | "abort";

export type Action =
  | { kind: "show"; tab: TabId }
  | { kind: "open"; overlay: OverlayName }
  | { kind: "stop" }
  | { kind: "lease"; action: "take" | "give_up" | "request" }
  | { kind: "start"; missionType: "ExplorationMission" | "InspectionMission" }
  | { kind: "mission"; call: MissionCall }
  | { kind: "drive"; to: Location }
  | { kind: "preset"; name: string }
  | { kind: "light"; color: keyof typeof LED_COLORS | "auto" }
  | { kind: "examine" }
  | { kind: "language"; language: Language };

export interface Command {
  id: string;
  group: TextKey;
  label: TextKey;
  values?: TextValues;
  /** Texts of the catalog that stand for values of `label`. */
  valueKeys?: Record<string, TextKey>;
  action: Action;
  /** Why it cannot be given now; null where it can. */
  obstacle: Reason | null;
  /** What it ends or replaces, so that it is confirmed; absent where it ends nothing. */
  ends?: TextKey;
}

export interface CommandFacts {
  linkOpen: boolean;
  isRewound: boolean;
  /** Whether this browser may command: it has control, or could take it. */
  mayCommand: boolean;
  hasControl: boolean;
  holder: string | null;
  isViewer: boolean;
  /** What the mission's own buttons go by; without a mission there are none. */
  mission: MissionFacts;
  /** Why no goal can be sent, as on the map; null where it can. */
  goalObstacle: Reason | null;
  /** Navigation pursues a goal, which another goal and a mission replace. */
  navigates: boolean;
  /** Why the arm cannot be moved to a preset, as in its view; null where it can. */
  presetObstacle: Reason | null;
  locations: Readonly<Record<string, Location>>;
  language: Language;
}

/** All commands, in the order in which the palette shows them. */
export function commandsFor(facts: CommandFacts): Command[] {
  return [...robotCommands(facts), ...missionCommands(facts), ...viewCommands(), ...motionCommands(facts), ...consoleCommands(facts)];
}

function viewCommands(): Command[] {
  return TABS.map(({ id, label }) => ({
    id: `show ${id}`,
    group: "palette_views",
    label: "palette_show",
    valueKeys: { view: label },
    action: { kind: "show", tab: id },
    obstacle: null,
  }));
}

function robotCommands({ hasControl, holder, isViewer, isRewound }: CommandFacts): Command[] {
  const commands: Command[] = [{ id: "stop", group: "palette_robot", label: "palette_stop", action: { kind: "stop" }, obstacle: null }];
  const lease = (label: TextKey, action: "take" | "give_up" | "request") =>
    commands.push({ id: action, group: "palette_robot", label, action: { kind: "lease", action }, obstacle: reasonOf(isViewer ? "you_are_viewer" : isRewound && action !== "give_up" ? "rewind_no_command" : null) });
  if (hasControl) lease("give_up_control", "give_up");
  else if (holder === null) lease("take_control", "take");
  else lease("ask_for_control", "request");
  return commands;
}

function reasonOf(key: TextKey | null): Reason | null {
  return key === null ? null : { key };
}

/** Why nothing can be commanded, not even what moves nothing. */
function obstacleOf({ linkOpen, isRewound, mayCommand }: CommandFacts): Reason | null {
  return reasonOf(isRewound ? "rewind_no_command" : !linkOpen ? "palette_no_link" : mayCommand ? null : "palette_needs_control");
}

function missionCommands({ mission: facts, navigates }: CommandFacts): Command[] {
  const { mission } = facts;
  const commands: Command[] = [];
  const add = (id: string, label: TextKey, action: Action, request: MissionAction, values?: TextValues) => {
    const ends = request === "start" && navigates ? "map_replaces_goal" : ENDS[request];
    const optional = { ...(values === undefined ? {} : { values }), ...(ends === null ? {} : { ends }) };
    commands.push({ id, group: "palette_mission", label, action, obstacle: reasonOf(refusal(request, facts)), ...optional });
  };
  if (mission === null) return [];
  if (!isActive(mission)) {
    add("start exploration", "palette_start_exploration", { kind: "start", missionType: "ExplorationMission" }, "start");
    add("start inspection", "palette_start_inspection", { kind: "start", missionType: "InspectionMission" }, "start");
    return commands;
  }
  if (mission.paused) add("resume", "palette_resume", { kind: "mission", call: "resume" }, "resume");
  else add("pause", "palette_pause", { kind: "mission", call: "pause" }, "pause");
  if (mission.lifecycle_state === "INSPECTING" && mission.current_target !== "") {
    add("skip", "palette_skip", { kind: "mission", call: "skip" }, "skip", { tag: mission.current_target });
  }
  add("abort", "palette_abort", { kind: "mission", call: "abort" }, "abort");
  return commands;
}

function motionCommands(facts: CommandFacts): Command[] {
  const drives = Object.entries(facts.locations).map(([name, to]): Command => ({
    id: `drive ${name}`,
    group: "palette_locations",
    label: "palette_go_to",
    values: { location: name },
    action: { kind: "drive", to },
    obstacle: facts.goalObstacle,
    ...(facts.navigates ? { ends: "map_replaces_goal" } : {}),
  }));
  const presets = Object.keys(ARM_PRESETS).map((name): Command => ({
    id: `preset ${name}`,
    group: "palette_arm",
    label: "palette_preset",
    values: { preset: name },
    action: { kind: "preset", name },
    obstacle: facts.presetObstacle,
  }));
  const lights = Object.keys(LED_COLORS).map((color): Command => ({
    id: `light ${color}`,
    group: "palette_lights",
    label: "palette_light",
    valueKeys: { color: `light_${color as keyof typeof LED_COLORS}` },
    action: { kind: "light", color: color as keyof typeof LED_COLORS },
    obstacle: obstacleOf(facts),
  }));
  const auto: Command = {
    id: "light auto",
    group: "palette_lights",
    label: "palette_light_auto",
    action: { kind: "light", color: "auto" },
    obstacle: obstacleOf(facts),
  };
  return [...drives, ...presets, auto, ...lights];
}

function consoleCommands({ language }: CommandFacts): Command[] {
  const open = (overlay: OverlayName, label: TextKey): Command => ({
    id: `open ${overlay}`,
    group: "palette_console",
    label,
    action: { kind: "open", overlay },
    obstacle: null,
  });
  const others = LANGUAGES.filter(({ value }) => value !== language).map(({ value, label }): Command => ({
    id: `language ${value}`,
    group: "palette_console",
    label: "palette_language",
    values: { language: label },
    action: { kind: "language", language: value },
    obstacle: null,
  }));
  return [
    { id: "examine", group: "palette_console", label: "run_doctor", action: { kind: "examine" }, obstacle: null },
    open("doctor", "doctor"),
    open("settings", "settings"),
    open("runs", "settings_runs"),
    open("share", "settings_share"),
    open("keys", "keys_title"),
    ...others,
  ];
}
