import { useMission } from "@/hooks/use_situation";

/** The mission's last event in its own words. */
export function LastEvent() {
  const mission = useMission();
  if (mission === null || mission.last_event === "") return null;
  return <p lang="en" className="min-w-0 truncate text-text-2 max-lg:hidden">{mission.last_event}</p>;
}
