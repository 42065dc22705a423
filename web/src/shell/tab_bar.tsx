import { useText } from "@/i18n/text";
import { showTab, useRoute } from "@/state/route";
import { TABS } from "@/tabs/table";
import { cn } from "@/ui/cn";

/** The tabs: a row below the top bar, icons at the bottom of a phone. */
export function TabBar() {
  const text = useText();
  const shown = useRoute((state) => state.tab);
  return (
    <nav aria-label={text("tabs")} className="border-line max-md:border-t md:border-b">
      <div role="tablist" className="flex h-(--tabs) max-md:justify-between md:px-2">
        {TABS.map(({ id, number, label, icon: Icon }, index) => {
          const selected = id === shown;
          return (
            <button
              key={id}
              id={`tab-${id}`}
              type="button"
              role="tab"
              aria-selected={selected}
              aria-controls="view"
              tabIndex={selected ? 0 : -1}
              onClick={() => showTab(id)}
              onKeyDown={(event) => {
                const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
                const next = TABS[(index + step + TABS.length) % TABS.length];
                if (step === 0 || next === undefined) return;
                showTab(next.id);
                document.getElementById(`tab-${next.id}`)?.focus();
              }}
              className={cn(
                "relative flex items-center gap-2 px-3 text-base whitespace-nowrap max-lg:px-2 max-md:grow max-md:flex-col max-md:justify-center max-md:gap-0.5 max-md:px-0",
                selected ? "font-semibold text-text" : "text-text-2 hover:text-text",
              )}
            >
              <span aria-hidden="true" className={cn("text-sm numeric max-md:hidden", selected ? "text-alive" : "text-text-3")}>
                {number}
              </span>
              <Icon className="size-6 md:hidden" />
              <span className="max-md:text-xs">{text(label)}</span>
              {selected && <span aria-hidden="true" className="absolute inset-x-3 bottom-0 h-0.5 bg-alive max-md:inset-x-2" />}
            </button>
          );
        })}
      </div>
    </nav>
  );
}
