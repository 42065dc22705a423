import { Save, Trash2 } from "lucide-react";
import { useEffect, useState } from "react";
import { getJson, postJson } from "@/api/http";
import { useNavigates } from "@/hooks/use_situation";
import { errorText } from "@/i18n/error_text";
import { useText } from "@/i18n/text";
import { type SavedMap, type SavedMaps, deleteObstacle, loadObstacle } from "@/map/saved_maps";
import { useIsMissionStale, useMissionFacts, useMissionState } from "@/map/use_mission";
import { showDone, showProblem } from "@/state/problems";
import { cn } from "@/ui/cn";
import { CommandLine } from "@/ui/command_line";
import { HoldButton } from "@/ui/hold_button";
import { Part, SaveForm } from "./part";

interface MapList {
  saved: SavedMaps | null;
  problem: string;
}

async function readMaps(): Promise<MapList> {
  try {
    return { saved: await getJson<SavedMaps>("/_api/maps"), problem: "" };
  } catch (error) {
    return { saved: null, problem: errorText(error) };
  }
}

/** The saved maps: one is chosen, and then loaded, deleted or used in another run. */
export function SavedMapsPart() {
  const text = useText();
  const [{ saved, problem }, setList] = useState<MapList>({ saved: null, problem: "" });
  const [chosen, setChosen] = useState<string | null>(null);
  const [busyWith, setBusyWith] = useState<string | null>(null);
  useEffect(() => void readMaps().then(setList), []);
  const change = async (name: string, path: "/_api/maps/load" | "/_api/maps/delete", done: string) => {
    setBusyWith(name);
    try {
      await postJson(path, { name });
      showDone(done);
    } catch (error) {
      showProblem(error);
    }
    setList(await readMaps());
    setBusyWith(null);
  };
  const save = async (name: string, replace: boolean) => {
    await postJson("/_api/maps", { name, replace });
    showDone(text("map_saved_map", { name }));
    setList(await readMaps());
    setChosen(name);
  };
  return (
    <Part title={text("map_maps")}>
      {problem !== "" && <p className="text-sm text-attention">{text("map_maps_failed", { reason: problem })}</p>}
      {saved?.maps.length === 0 && <p className="text-text-3">{text("map_no_maps")}</p>}
      {saved !== null && saved.maps.length > 0 && (
        <ul className="flex flex-col">
          {saved.maps.map((map) => (
            <li key={map.name} className="border-b border-line">
              <button
                type="button"
                aria-expanded={map.name === chosen}
                onClick={() => setChosen(map.name === chosen ? null : map.name)}
                className={cn("flex min-h-11 w-full items-center gap-2 text-left hover:bg-hover", map.name === chosen && "font-bold")}
              >
                <span className="min-w-0 grow truncate font-semibold">{map.name}</span>
                {map.name === saved.loaded && <span className="shrink-0 text-xs text-alive">{text("map_loaded_now")}</span>}
              </button>
              {map.name === chosen && <Chosen map={map} loaded={saved.loaded} isBusy={busyWith !== null} isLoading={busyWith === map.name} change={change} />}
            </li>
          ))}
        </ul>
      )}
      <SaveForm label={text("map_save_map")} placeholder={text("map_save_map_hint")} icon={<Save />} taken={saved?.maps.map(({ name }) => name) ?? []} save={save} />
    </Part>
  );
}

interface ChosenProps {
  map: SavedMap;
  loaded: string | null;
  isBusy: boolean;
  isLoading: boolean;
  change: (name: string, path: "/_api/maps/load" | "/_api/maps/delete", done: string) => Promise<void>;
}

function Chosen({ map, loaded, isBusy, isLoading, change }: ChosenProps) {
  const text = useText();
  const { name, command } = map;
  const mission = useMissionState();
  const facts = { ...useMissionFacts(useIsMissionStale() ? null : mission), navigates: useNavigates() };
  const [againstLoad, againstDelete] = [loadObstacle(map, facts), deleteObstacle(map, loaded, facts)];
  const obstacle = againstLoad ?? againstDelete;
  return (
    <div className="flex flex-col gap-2 pb-3">
      <div className="flex flex-wrap gap-2">
        <HoldButton
          tone="dark"
          disabled={isBusy || againstLoad !== null}
          aria-label={text("map_load_hold", { name })}
          className="h-9 px-3 text-xs max-xl:h-11 pointer-coarse:h-11"
          onHeld={() => void change(name, "/_api/maps/load", text("map_loaded_map", { name }))}
        >
          {text(isLoading ? "map_loading_map" : "map_load_map")}
        </HoldButton>
        <HoldButton
          tone="dark"
          disabled={isBusy || againstDelete !== null}
          aria-label={text("map_delete_hold", { name })}
          className="h-9 px-3 text-xs max-xl:h-11 pointer-coarse:h-11 [&_svg]:size-4"
          onHeld={() => void change(name, "/_api/maps/delete", text("map_deleted_map", { name }))}
        >
          <Trash2 aria-hidden="true" />
          {text("map_delete_map")}
        </HoldButton>
      </div>
      {obstacle !== null && <p className="text-xs text-attention">{text(againstLoad === null ? "map_cannot_delete" : "map_cannot_load", { reason: text(obstacle) })}</p>}
      {againstLoad === null && <p className="text-xs text-text-3">{text("map_load_hint")}</p>}
      {command !== null && (
        <>
          <p className="text-xs text-text-3">{text("map_command_hint")}</p>
          <CommandLine command={command} />
        </>
      )}
    </div>
  );
}
