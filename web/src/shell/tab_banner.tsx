import { Copy } from "lucide-react";
import { useText } from "@/i18n/text";
import { takeOverTab, useTabRole } from "@/safety/commanding_tab";
import { Button } from "@/ui/button";

/** Says that another tab of this browser commands, and takes over from it. */
export function TabBanner() {
  const text = useText();
  const isWatching = useTabRole(({ role }) => role === "watching");
  if (!isWatching) return null;
  return (
    <div role="status" data-testid="other-tab" className="flex min-h-12 shrink-0 flex-wrap items-center gap-x-4 gap-y-2 border-b border-line-strong bg-raised px-4 py-2">
      <Copy aria-hidden="true" className="size-5 shrink-0 text-text-2" />
      <p className="min-w-0 grow basis-60">
        <strong className="font-semibold">{text("other_tab_has_control")}</strong>
        <span className="block text-xs text-text-2">{text("other_tab_explained")}</span>
      </p>
      <Button onClick={takeOverTab}>{text("other_tab_take_over")}</Button>
    </div>
  );
}
