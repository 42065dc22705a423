/** Runs the palette's commands. */
import { postJson } from "@/api/http";
import type { Location } from "@/api/console_store";
import { SERVICES, TOPICS } from "@/generated/graph";
import { LED_COLORS } from "@/generated/robot";
import { setLanguage } from "@/i18n/text";
import { TextError } from "@/i18n/text_error";
import { MISSION_SERVICES } from "@/map/mission_rules";
import { call, publish } from "@/robot/commands";
import { stop } from "@/robot/stop";
import { showTab } from "@/state/route";
import { setting } from "@/state/settings";
import { examine } from "@/api/doctor";
import { showOverlay } from "@/state/overlays";
import type { Action } from "./commands";

/** Returns what the robot answered; null if it answered nothing. Throws with the reason of a refusal. */
export async function perform(action: Action): Promise<"done" | "sent" | null> {
  switch (action.kind) {
    case "show":
      showTab(action.tab);
      return null;
    case "open":
      showOverlay(action.overlay);
      return null;
    case "examine":
      showOverlay("doctor");
      await examine();
      return null;
    case "language":
      await setLanguage(action.language);
      return null;
    case "stop":
      stop();
      return null;
    case "lease":
      await postJson("/_api/lease", { action: action.action });
      return null;
    case "start": {
      const answer = await call(SERVICES.MISSION_START, { mission_type: action.missionType, tag_sequence: [], discovery_goal: 0 });
      if (!answer.accepted) throw new Error(answer.error_message);
      return "done";
    }
    case "mission":
      return accepted(await call(MISSION_SERVICES[action.call], {}));
    case "preset":
      return accepted(await call(SERVICES.ARM_PRESET, { name: action.name }), "sent");
    case "light": {
      if (action.color === "auto") return accepted(await call(SERVICES.LEDS_AUTO, {}));
      const [r, g, b] = LED_COLORS[action.color];
      const { status } = await call(SERVICES.LEDS_SET, { color: { r, g, b } });
      if (!status) throw new TextError("error_light_not_ready");
      return "done";
    }
    case "drive":
      if (!sendGoal(action.to)) throw new TextError("error_not_connected");
      return "sent";
  }
}

function accepted(answer: { success: boolean; message: string }, outcome: "done" | "sent" = "done"): "done" | "sent" {
  if (!answer.success) throw new Error(answer.message);
  return outcome;
}

function sendGoal({ x, y, yaw }: Location): boolean {
  return publish(
    { ...TOPICS.GOAL_POSE, name: setting("goalPoseTopic") },
    {
      header: { stamp: { sec: 0, nanosec: 0 }, frame_id: setting("mapFrame") },
      pose: { position: { x, y, z: 0 }, orientation: { x: 0, y: 0, z: Math.sin(yaw / 2), w: Math.cos(yaw / 2) } },
    },
  );
}
