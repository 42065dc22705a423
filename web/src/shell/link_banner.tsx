import { Unplug } from "lucide-react";
import { useConsole } from "@/api/console_store";
import { useAge } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import { useLink } from "@/robot/link";
import { formatDuration } from "@/ui/numbers";

/** Says that nothing arrives any more; grey, since a lost link is not a fault of the robot. */
export function LinkBanner() {
  const text = useText();
  const lostMs = useLink((link) => link.lostMs);
  const wasOpen = useLink((link) => link.wasOpen);
  const online = useConsole((state) => state.online);
  const onlineChangedMs = useConsole((state) => state.onlineChangedMs);
  const linkAge = useAge(lostMs);
  const serverAge = useAge(onlineChangedMs);
  if (linkAge !== null) return <Banner message={text("link_lost_banner")} age={linkAge} />;
  if (!online && wasOpen && (serverAge ?? 0) > 3) return <Banner message={text("server_lost_banner")} age={serverAge} />;
  return null;
}

/** The age is not read out: an alert that changed with it would be, all the time. */
function Banner({ message, age }: { message: string; age: number | null }) {
  return (
    <div className="flex min-h-12 shrink-0 items-center gap-3 border-b border-line-strong bg-raised px-4 py-2 text-text-2 hatched">
      <Unplug aria-hidden="true" className="size-5 shrink-0" />
      <p role="alert">{message}</p>
      <span aria-hidden="true" data-testid="loss-age" className="ml-auto shrink-0 font-semibold numeric">
        {formatDuration(age)}
      </span>
    </div>
  );
}
