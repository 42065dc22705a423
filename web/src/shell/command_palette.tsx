import { Command } from "cmdk";
import { Search } from "lucide-react";
import { useEffect, useRef, useState } from "react";
import { hasControl, useConsole } from "@/api/console_store";
import { useMotionObstacles, useNavigates } from "@/hooks/use_situation";
import { type Text, type TextKey, useLanguage, useText } from "@/i18n/text";
import { useIsMissionStale, useMissionFacts, useMissionState } from "@/map/use_mission";
import { useIsRewound } from "@/state/rewind";
import { useLink } from "@/robot/link";
import { stop } from "@/robot/stop";
import { useTabRole } from "@/safety/commanding_tab";
import { showDone, showProblem } from "@/state/problems";
import { usePresetObstacles } from "@/tabs/arm/use_arm";
import { Dialog } from "@/ui/dialog";
import { useOverlayState } from "@/state/overlays";
import { type Command as PaletteCommand, commandsFor } from "./palette/commands";
import { perform } from "./palette/perform";
import { scoreOf } from "./palette/search";

/** A second choice within this time belongs to the first one, as of a double click. */
const APART_MS = 400;

interface Choice {
  id: string;
  /** performance.now() */
  atMs: number;
}

function firstChoice(id: string): Choice {
  return { id, atMs: performance.now() };
}

function isConfirmed(pending: Choice | null, id: string): boolean {
  return pending?.id === id && performance.now() - pending.atMs >= APART_MS;
}

/** Every command by its name: Ctrl or Cmd and K. */
export function CommandPalette() {
  const text = useText();
  const [isOpen, setOpen] = useOverlayState("palette");
  return (
    <Dialog open={isOpen} onOpenChange={setOpen} title={text("palette")} className="w-[min(620px,calc(100vw-1.5rem))]">
      {isOpen && <Commands onChosen={() => setOpen(false)} />}
    </Dialog>
  );
}

function Commands({ onChosen }: { onChosen: () => void }) {
  const text = useText();
  const commands = useCommands();
  const [query, setQuery] = useState("");
  const input = useRef<HTMLInputElement>(null);
  /** The command that was chosen and waits for its confirmation. */
  const [pending, setPending] = useState<Choice | null>(null);
  useEffect(() => input.current?.focus(), []);
  const groups = [...new Set(commands.map(({ group }) => group))];

  async function choose(command: PaletteCommand): Promise<void> {
    if (command.ends !== undefined && !isConfirmed(pending, command.id)) {
      setPending((last) => (last?.id === command.id ? last : firstChoice(command.id)));
      return;
    }
    onChosen();
    try {
      const outcome = await perform(command.action);
      if (outcome !== null) showDone(text(outcome === "done" ? "palette_done" : "palette_sent", { command: labelOf(command, text) }));
    } catch (error) {
      showProblem(error);
    }
  }

  return (
    <Command label={text("palette")} loop filter={(_id, typed, [label = ""] = []) => scoreOf(label, typed)} className="flex flex-col gap-2">
      <div className="flex items-center gap-3 rounded-md border border-line-strong bg-well px-3">
        <Search aria-hidden="true" className="size-5 shrink-0 text-text-3" />
        <Command.Input
          ref={input}
          value={query}
          onValueChange={(typed) => {
            setQuery(typed);
            setPending(null);
          }}
          placeholder={text("palette_search")}
          onKeyDown={(event) => {
            // A key that is held chooses once: it must not confirm, too.
            if (event.key === "Enter" && event.repeat) event.preventDefault();
            // No command begins with a space, so it stops here too.
            if (event.code !== "Space" || query !== "") return;
            event.preventDefault();
            if (!event.repeat) stop();
          }}
          className="h-12 w-full bg-transparent text-base outline-none placeholder:text-text-3"
        />
      </div>
      <Command.List className="max-h-[min(60dvh,520px)] overflow-y-auto">
        <Command.Empty className="py-6 text-center text-text-3">{text("palette_nothing")}</Command.Empty>
        {groups.map((group) => (
          <Command.Group key={group} heading={text(group)} className="[&_[cmdk-group-heading]]:px-3 [&_[cmdk-group-heading]]:pt-3 [&_[cmdk-group-heading]]:pb-1 [&_[cmdk-group-heading]]:text-xs [&_[cmdk-group-heading]]:text-text-3">
            {commands.filter((command) => command.group === group).map((command) => (
              <Item key={command.id} command={command} text={text} isPending={pending?.id === command.id} onSelect={() => void choose(command)} />
            ))}
          </Command.Group>
        ))}
      </Command.List>
    </Command>
  );
}

function Item({ command, text, isPending, onSelect }: { command: PaletteCommand; text: Text; isPending: boolean; onSelect: () => void }) {
  const { id, obstacle, ends } = command;
  const label = labelOf(command, text);
  return (
    <Command.Item
      value={id}
      keywords={[label]}
      disabled={obstacle !== null}
      onSelect={onSelect}
      className="flex min-h-11 cursor-pointer items-center gap-3 rounded-md px-3 text-sm data-[disabled=true]:cursor-not-allowed data-[disabled=true]:text-text-3 data-[selected=true]:bg-hover"
    >
      <span className="grow">{label}</span>
      {obstacle !== null && <span className="text-xs text-text-3">{text(obstacle.key, obstacle.values)}</span>}
      {obstacle === null && isPending && ends !== undefined && (
        <span role="status" className="text-right text-xs text-attention">
          {text(ends)}. {text("palette_confirm")}
        </span>
      )}
    </Command.Item>
  );
}

function labelOf({ label, values, valueKeys = {} }: PaletteCommand, text: Text): string {
  const translated = Object.fromEntries(Object.entries(valueKeys).map(([name, key]: [string, TextKey]) => [name, text(key)]));
  return text(label, { ...values, ...translated });
}

function useCommands(): PaletteCommand[] {
  const linkOpen = useLink((link) => link.state === "open");
  const isRewound = useIsRewound();
  const state = useConsole();
  const missionState = useMissionState();
  const mission = useMissionFacts(useIsMissionStale() ? null : missionState);
  const goalObstacle = useMotionObstacles()[0] ?? null;
  const navigates = useNavigates();
  const presetObstacle = usePresetObstacles()[0] ?? null;
  const language = useLanguage((store) => store.language);
  const mine = hasControl(state);
  const { holder } = state.control;
  const isViewer = state.session?.role === "viewer";
  const isWatching = useTabRole(({ role }) => role === "watching");
  return commandsFor({
    linkOpen,
    isRewound,
    mayCommand: !isViewer && !isWatching && (mine || holder === null),
    hasControl: mine,
    holder,
    isViewer,
    mission,
    goalObstacle,
    navigates,
    presetObstacle,
    locations: state.locations,
    language,
  });
}
