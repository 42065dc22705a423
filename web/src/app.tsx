import { Suspense, useEffect } from "react";
import { useConsole } from "@/api/console_store";
import { IS_MOCK } from "@/environment";
import { useIsPhone } from "@/hooks/use_is_phone";
import { useText } from "@/i18n/text";
import { Aurora } from "@/shell/aurora";
import { BootSequence } from "@/shell/boot_sequence";
import { EventLine } from "@/shell/event_line";
import { LinkBanner } from "@/shell/link_banner";
import { Messages } from "@/shell/messages";
import { OverlayHost } from "@/shell/overlay_host";
import { Pairing } from "@/shell/pairing";
import { StopBar } from "@/shell/stop_bar";
import { StoppedBanner } from "@/shell/stopped_banner";
import { TabBar } from "@/shell/tab_bar";
import { TopBar } from "@/shell/top_bar";
import { useRoute } from "@/state/route";
import { useSetting } from "@/state/settings";
import { TABS } from "@/tabs/table";

export function App() {
  const known = useConsole((state) => state.known);
  const own = useConsole((state) => state.own);
  const solid = useSetting("reduceTransparency");
  const contrast = useSetting("surfaceContrast");
  // On the root element, as dialogs are drawn outside of the app's own.
  useEffect(() => {
    document.documentElement.classList.toggle("solid-surfaces", solid);
    document.documentElement.classList.toggle("high-contrast", contrast === "high");
  }, [solid, contrast]);
  const needsPairing = known && own === null && !IS_MOCK;
  return (
    <div className="h-full">
      <Aurora />
      {needsPairing ? <Pairing /> : <Cockpit />}
      <Messages />
    </div>
  );
}

function Cockpit() {
  const text = useText();
  const isPhone = useIsPhone();
  const shown = useRoute((state) => state.tab);
  const tab = TABS.find(({ id }) => id === shown);
  const View = tab?.view;
  return (
    <div className="flex h-full max-md:flex-col">
      <div className="flex min-h-0 min-w-0 grow flex-col">
        <TopBar />
        {!isPhone && <TabBar />}
        <LinkBanner />
        <StoppedBanner />
        <main className="flex min-h-0 grow basis-0 flex-col">
          <div id="view" role="tabpanel" aria-label={tab && text(tab.label)} className="min-h-0 grow basis-0 overflow-auto p-3">
            <Suspense fallback={<p className="p-4 text-text-2">{text("loading")}</p>}>{View !== undefined && <View />}</Suspense>
          </div>
        </main>
        <EventLine />
      </div>
      <StopBar />
      <BootSequence />
      <OverlayHost />
      {isPhone && <TabBar />}
    </div>
  );
}
