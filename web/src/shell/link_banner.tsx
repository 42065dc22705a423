import { Unplug } from "lucide-react";
import { useConsole } from "@/api/console_store";
import { useAge } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import { useLink } from "@/robot";
import { span } from "@/ui/numbers";

/** That nothing arrives any more: grey, since a lost link is not a fault of the robot. */
export function LinkBanner() {
  const text = useText();
  const link = useLink();
  const online = useConsole((state) => state.online);
  const changedMs = useConsole((state) => state.changedMs);
  const linkAge = useAge(link.changedMs);
  const serverAge = useAge(changedMs);
  if (link.state !== "open" && link.wasOpen) return <Banner message={text("link_lost_banner", { age: span(linkAge) })} />;
  if (!online && link.wasOpen && (serverAge ?? 0) > 3) return <Banner message={text("server_lost_banner", { age: span(serverAge) })} />;
  return null;
}

function Banner({ message }: { message: string }) {
  return (
    <div role="alert" className="flex min-h-12 shrink-0 items-center gap-3 border-b border-line-strong bg-raised px-4 py-2 text-text-2 hatched">
      <Unplug aria-hidden="true" className="size-5 shrink-0" />
      <p>{message}</p>
    </div>
  );
}
