import { useEffect } from "react";
import { startMissionLog } from "@/map/mission_log";
import { useField } from "@/map/use_field";
import { useLiveMap } from "@/map/use_live_map";
import { usePathPreview } from "@/map/use_path_preview";
import { Details } from "./details";
import { MapView } from "./map_view";
import { MissionPanel } from "./mission_panel";
import { TargetPanel } from "./target_panel";

/** The Map tab: the mapped greenhouse, the mission in it, and what the digital twin knows about its plants. */
export default function MapTab() {
  useLiveMap();
  useField();
  usePathPreview();
  useEffect(startMissionLog, []);
  return (
    <div className="grid gap-3 lg:h-full lg:min-h-0 lg:grid-cols-[minmax(0,1fr)_20rem] lg:grid-rows-[auto_minmax(0,1fr)_auto] xl:grid-cols-[minmax(0,1fr)_var(--column)]">
      <MapView className="h-[62vh] min-h-80 max-md:h-[52vh] lg:col-start-1 lg:row-span-2 lg:row-start-1 lg:h-auto lg:min-h-0" />
      <TargetPanel className="lg:col-start-2 lg:row-start-1" />
      <MissionPanel className="lg:col-start-1 lg:row-start-3" />
      <Details className="max-lg:min-h-96 lg:col-start-2 lg:row-span-2 lg:row-start-2" />
    </div>
  );
}
