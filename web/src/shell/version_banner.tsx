import { RefreshCw } from "lucide-react";
import { useConsole } from "@/api/console_store";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";

/** Says that the server has a newer page than this one. Reloading stops the robot of a page in control, so a person decides when. */
export function VersionBanner() {
  const text = useText();
  const isOutdated = useConsole((state) => state.isOutdated);
  if (!isOutdated) return null;
  return (
    <div className="flex min-h-12 shrink-0 flex-wrap items-center gap-x-4 gap-y-2 border-b border-line-strong bg-raised px-4 py-2">
      <RefreshCw aria-hidden="true" className="size-5 shrink-0 text-text-2" />
      <p role="status" className="min-w-0 grow basis-60">
        {text("page_outdated")}
      </p>
      <Button onClick={() => location.reload()}>{text("part_reload")}</Button>
    </div>
  );
}
