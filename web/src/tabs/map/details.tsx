import { Tabs } from "radix-ui";
import type { ReactNode } from "react";
import { useText } from "@/i18n/text";
import { useIsRewound } from "@/state/rewind";
import { cn } from "@/ui/cn";
import { EventList } from "./event_list";
import { GreenhouseTable } from "./greenhouse_table";
import { LightControl } from "./light_control";
import { PlacesPanel } from "./places_panel";

/** What commands the robot is switched off while the page shows the past. */
function Live({ children }: { children: ReactNode }) {
  return (
    <fieldset disabled={useIsRewound()} className="contents">
      {children}
    </fieldset>
  );
}

/** Panels in one place: the greenhouse is what a mission is about, the others are looked up. */
export function Details({ className }: { className?: string }) {
  const text = useText();
  const tabs: { id: string; label: string; view: ReactNode }[] = [
    { id: "greenhouse", label: text("map_greenhouse"), view: <GreenhouseTable /> },
    { id: "events", label: text("mission_events"), view: <EventList /> },
    { id: "places", label: text("map_places"), view: <Live><PlacesPanel /></Live> },
    { id: "lights", label: text("map_lights"), view: <Live><LightControl /></Live> },
  ];
  return (
    <Tabs.Root defaultValue="greenhouse" asChild>
      <section aria-label={text("map_details")} className={cn("panel flex min-h-0 min-w-0 flex-col overflow-hidden", className)}>
        <Tabs.List aria-label={text("map_details")} className="flex shrink-0 overflow-x-auto border-b border-line px-2">
          {tabs.map(({ id, label }) => (
            <Tabs.Trigger
              key={id}
              value={id}
              className="relative h-11 shrink-0 px-3 text-sm font-semibold text-text-2 hover:text-text focus-visible:-outline-offset-2 data-[state=active]:text-text data-[state=active]:after:absolute data-[state=active]:after:inset-x-2 data-[state=active]:after:bottom-0 data-[state=active]:after:h-0.5 data-[state=active]:after:bg-text-2"
            >
              {label}
            </Tabs.Trigger>
          ))}
        </Tabs.List>
        {tabs.map(({ id, view }) => (
          <Tabs.Content key={id} value={id} className="min-h-0 grow overflow-y-auto focus-visible:-outline-offset-2 data-[state=inactive]:hidden">
            {view}
          </Tabs.Content>
        ))}
      </section>
    </Tabs.Root>
  );
}
