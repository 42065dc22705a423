/** The keys of the map. Space is the stop, everywhere. */
import type { Pose2 } from "@/ros/tf";
import { toRadians } from "@/ui/numbers";
import { nudge } from "./goal";

export type MapCommand =
  | { do: "pan"; x: number; y: number }
  | { do: "zoom"; factor: number }
  | { do: "fit" | "follow" | "goal" | "cancel" | "send" }
  | { do: "draft"; pose: Pose2 };

const PAN_PX = 60;
const STEP_M = 0.1;
const FINE_STEP_M = 0.02;
const TURN_RAD = toRadians(15);
const ARROWS: Record<string, readonly [number, number]> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};

/** What a key does; null where it does nothing. With a drawn pose, the arrows move that instead of the map. */
export function commandOf(event: Pick<KeyboardEvent, "key" | "shiftKey" | "ctrlKey" | "metaKey" | "altKey">, draft: Pose2 | null, turned: boolean): MapCommand | null {
  if (event.ctrlKey || event.metaKey || event.altKey) return null;
  const arrow = ARROWS[event.key];
  if (arrow !== undefined) {
    const [right, up] = arrow;
    if (draft === null) return { do: "pan", x: -right * PAN_PX, y: up * PAN_PX };
    const step = event.shiftKey ? FINE_STEP_M : STEP_M;
    return { do: "draft", pose: nudge(draft, right * step, up * step, 0, turned) };
  }
  switch (event.key) {
    case "+":
    case "=":
      return { do: "zoom", factor: 1.25 };
    case "-":
    case "_":
      return { do: "zoom", factor: 0.8 };
    case "0":
      return { do: "fit" };
    case "f":
      return { do: "follow" };
    case "g":
      return { do: "goal" };
    case "[":
    case ",":
      return draft === null ? null : { do: "draft", pose: nudge(draft, 0, 0, TURN_RAD, turned) };
    case "]":
    case ".":
      return draft === null ? null : { do: "draft", pose: nudge(draft, 0, 0, -TURN_RAD, turned) };
    case "Enter":
      return draft === null ? null : { do: "send" };
    case "Escape":
      return { do: "cancel" };
    default:
      return null;
  }
}
