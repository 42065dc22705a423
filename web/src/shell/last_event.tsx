import { useMission } from "@/hooks/use_situation";
import { useText } from "@/i18n/text";
import { RobotWords } from "@/ui/robot_words";

/** The mission's last event in its own words. It may be long ago: the mission gives no time. */
export function LastEvent() {
  const text = useText();
  const mission = useMission();
  if (mission === null || mission.last_event === "") return null;
  return (
    <p className="min-w-0 shrink-[99] truncate text-text-2 max-lg:hidden">
      <span className="text-text-3">{text("mission_last_event")} </span>
      <RobotWords words={mission.last_event} />
    </p>
  );
}
