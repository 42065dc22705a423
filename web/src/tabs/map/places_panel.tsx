import { Crosshair, Download, MapPinPlus, Navigation, PencilLine, X } from "lucide-react";
import { type Location, useConsole } from "@/api/console_store";
import { postJson } from "@/api/http";
import { useText } from "@/i18n/text";
import { changeApproach, overridesFile } from "@/map/approaches";
import { liveMap } from "@/map/live_map";
import { chooseTool, drawPose, useMapUi } from "@/map/map_ui";
import { compareIds } from "@/map/twin";
import { usePoseState } from "@/map/use_presentation";
import { showDone, showProblem } from "@/state/problems";
import { Button } from "@/ui/button";
import { HoldButton } from "@/ui/hold_button";
import { fixed, toDegrees } from "@/ui/numbers";
import { Part, SaveForm } from "./part";
import { SavedMapsPart } from "./saved_maps_part";

/** Named locations, saved maps, the robot's pose, and approaches of tags. */
export function PlacesPanel() {
  return (
    <div className="flex flex-col gap-5 px-4 py-4">
      <Locations />
      <SavedMapsPart />
      <Relocation />
      <Approaches />
    </div>
  );
}

function Locations() {
  const text = useText();
  const locations = useConsole((state) => state.locations);
  const { isKnown, isStale } = usePoseState();
  const change = async (name: string, pose: Location | null) => {
    const changed = await postJson<Record<string, Location>>("/_api/locations", { name, pose });
    useConsole.setState({ locations: changed });
  };
  const saveHere = async (name: string) => {
    const { pose } = liveMap;
    if (pose === null) throw new Error(text("map_place_unknown"));
    await change(name, pose);
    showDone(text("map_saved_location", { name }));
  };
  return (
    <Part title={text("map_locations")}>
      <ul className="flex flex-col">
        {Object.entries(locations).map(([name, location]) => (
          <li key={name} className="flex min-h-12 items-center gap-2 border-b border-line">
            <div className="min-w-0 grow">
              <p className="truncate font-semibold">{name}</p>
              <p className="text-xs text-text-3 numeric">
                {fixed(location.x, 2)}, {fixed(location.y, 2)} m · {fixed(toDegrees(location.yaw), 0)}°
              </p>
            </div>
            <Button size="small" aria-label={text("map_go_to", { name })} onClick={() => drawPose({ kind: "goal", name, pose: location })}>
              <Navigation />
              {text("map_go")}
            </Button>
            <HoldButton
              tone="dark"
              aria-label={text(name === "home" ? "map_reset_home" : "map_remove", { name })}
              title={text(name === "home" ? "map_reset_home" : "map_remove", { name })}
              className="h-8 px-2 max-xl:h-11 pointer-coarse:h-11"
              onHeld={() => change(name, null).catch(showProblem)}
            >
              <X aria-hidden="true" className="size-4" />
            </HoldButton>
          </li>
        ))}
      </ul>
      <SaveForm label={text("map_save_here")} placeholder={text("map_save_here_hint")} icon={<MapPinPlus />} disabled={!isKnown || isStale} taken={Object.keys(locations)} save={saveHere} />
    </Part>
  );
}

function Relocation() {
  const text = useText();
  return (
    <Part title={text("map_relocate")}>
      <p className="text-sm text-text-2">{text("map_relocate_explained")}</p>
      <Button onClick={() => chooseTool("relocate")} className="self-start">
        <Crosshair />
        {text("map_relocate")}
      </Button>
    </Part>
  );
}

function Approaches() {
  const text = useText();
  const selected = useMapUi((state) => state.selected);
  const approaches = useConsole((state) => state.approaches);
  const tags = Object.keys(approaches).toSorted(compareIds);
  return (
    <Part title={text("map_approaches")}>
      <p className="text-sm text-text-2">{text("map_approaches_explained", { command: "lupin up --overrides overrides.yaml" })}</p>
      {tags.length > 0 && (
        <ul className="flex flex-wrap gap-2">
          {tags.map((tag) => (
            <li key={tag} className="flex items-center gap-1 rounded-sm border border-line bg-raised pl-2">
              {tag}
              <Button kind="quiet" size="small" aria-label={text("map_remove_approach", { tag })} onClick={() => void changeApproach(tag, null).catch(showProblem)} className="px-2">
                <X />
              </Button>
            </li>
          ))}
        </ul>
      )}
      <div className="flex flex-wrap gap-2">
        <Button disabled={selected === null} onClick={() => chooseTool("approach")}>
          <PencilLine />
          {selected === null ? text("map_draw_approach_none") : text("map_draw_approach", { tag: selected })}
        </Button>
        {tags.length > 0 && (
          <Button onClick={() => download("overrides.yaml", overridesFile(approaches))}>
            <Download />
            {text("map_download_overrides", { count: tags.length })}
          </Button>
        )}
      </div>
    </Part>
  );
}

function download(name: string, content: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type: "application/yaml" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
