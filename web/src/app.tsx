import { Suspense, useEffect } from "react";
import { useConsole } from "@/api/console_store";
import { IS_MOCK } from "@/environment";
import { useIsPhone } from "@/hooks/use_is_phone";
import { useText } from "@/i18n/text";
import { Aurora } from "@/shell/aurora";
import { BootSequence } from "@/shell/boot_sequence";
import { ElsewhereBanner } from "@/shell/elsewhere_banner";
import { EventLine } from "@/shell/event_line";
import { LinkBanner } from "@/shell/link_banner";
import { Messages } from "@/shell/messages";
import { OverlayHost } from "@/shell/overlay_host";
import { Pairing } from "@/shell/pairing";
import { PlainStop, StopBar } from "@/shell/stop_bar";
import { StoppedBanner } from "@/shell/stopped_banner";
import { TabBanner } from "@/shell/tab_banner";
import { TabBar } from "@/shell/tab_bar";
import { TopBar } from "@/shell/top_bar";
import { VersionBanner } from "@/shell/version_banner";
import { WheelsBanner } from "@/shell/wheels_banner";
import { RewindBar, useRewindKeys } from "@/rewind/rewind_bar";
import { ShownTime } from "@/rewind/shown_time";
import { useIsRewound } from "@/state/rewind";
import { driver } from "@/robot/driving";
import { Boundary, type FallbackProps, PartFailed } from "@/ui/boundary";
import { cn } from "@/ui/cn";
import { useRoute } from "@/state/route";
import { useSetting } from "@/state/settings";
import { TABS } from "@/tabs/table";
import { drawsInSoftware } from "@/widgets/webgl";

const letGo = () => driver.letGo();

export function App() {
  return (
    <Boundary fallback={PageFailed}>
      <Page />
    </Boundary>
  );
}

/** What is left of a page that failed as a whole: the reason, and the stop. */
function PageFailed(props: FallbackProps) {
  return (
    <div className="flex h-full max-md:flex-col">
      <div className="min-w-0 grow p-5">
        <PartFailed {...props} />
      </div>
      <PlainStop />
    </div>
  );
}

function Page() {
  const sessionLoaded = useConsole((state) => state.sessionLoaded);
  const session = useConsole((state) => state.session);
  const solid = useSetting("reduceTransparency");
  const contrast = useSetting("surfaceContrast");
  const isLight = useSetting("theme") === "light";
  // On the root element, as dialogs are drawn outside of the app's own.
  useEffect(() => {
    // The CPU would blur what lies behind a drawer in every frame of the map.
    document.documentElement.classList.toggle("solid-surfaces", solid || drawsInSoftware());
    document.documentElement.classList.toggle("high-contrast", contrast === "high");
    document.documentElement.classList.toggle("light", isLight);
  }, [solid, contrast, isLight]);
  const needsPairing = sessionLoaded && session === null && !IS_MOCK;
  return (
    <div className="h-full">
      <Boundary>
        <Aurora />
      </Boundary>
      {needsPairing ? <Pairing /> : <Cockpit />}
      <Boundary>
        <Messages />
      </Boundary>
    </div>
  );
}

function Cockpit() {
  const text = useText();
  const isPhone = useIsPhone();
  const shown = useRoute((state) => state.tab);
  const tab = TABS.find(({ id }) => id === shown);
  const View = tab?.view;
  const isRewound = useIsRewound();
  useRewindKeys();
  return (
    <div className="flex h-full max-md:flex-col">
      <div className="flex min-h-0 min-w-0 grow flex-col">
        <Boundary>
          <TopBar />
        </Boundary>
        {!isPhone && <TabBar />}
        <Boundary>
          <LinkBanner />
          <VersionBanner />
          <ElsewhereBanner />
          <TabBanner />
          <StoppedBanner />
          <WheelsBanner />
          <RewindBar />
        </Boundary>
        <main className="flex min-h-0 grow basis-0 flex-col">
          <div id="view" role="tabpanel" aria-label={tab && text(tab.label)} className={cn("min-h-0 grow basis-0 overflow-auto p-3", isRewound && "border-4 border-attention")}>
            <Boundary key={shown} onFailure={letGo}>
              <ShownTime>
                <Suspense fallback={<p className="p-4 text-text-2">{text("loading")}</p>}>{View !== undefined && <View />}</Suspense>
              </ShownTime>
            </Boundary>
          </div>
        </main>
        <Boundary>
          <EventLine />
        </Boundary>
      </div>
      <Boundary fallback={PlainStop}>
        <StopBar />
      </Boundary>
      <Boundary>
        <BootSequence />
        <OverlayHost />
      </Boundary>
      {isPhone && <TabBar />}
    </div>
  );
}
