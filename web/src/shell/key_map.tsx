import { type TextKey, useText } from "@/i18n/text";
import { Dialog } from "@/ui/dialog";
import { useOverlayState } from "@/state/overlays";
import { TABS } from "@/tabs/table";

interface Row {
  /** Keys as printed on them, or a text of the catalog. */
  keys: readonly (string | { key: TextKey })[];
  meaning: TextKey;
}

const ROWS: readonly Row[] = [
  { keys: [{ key: "key_space" }], meaning: "keys_stop" },
  { keys: [{ key: "key_enter" }], meaning: "keys_release" },
  { keys: ["Ctrl K", "⌘ K"], meaning: "keys_palette" },
  { keys: ["1", "…", String(TABS.length)], meaning: "keys_tabs" },
  { keys: ["←", "→"], meaning: "keys_arrows" },
  { keys: ["W", "A", "S", "D"], meaning: "keys_move" },
  { keys: ["Q", "E"], meaning: "keys_turn" },
  { keys: ["R"], meaning: "keys_rewind" },
  { keys: ["L"], meaning: "keys_live" },
  { keys: ["?"], meaning: "keys_map" },
  { keys: [{ key: "key_escape" }], meaning: "keys_close" },
];

/** What the keys do: shown by ?. */
export default function KeyMap() {
  const text = useText();
  const [isOpen, setOpen] = useOverlayState("keys");
  return (
    <Dialog open={isOpen} onOpenChange={setOpen} title={text("keys_title")} description={text("keys_places")}>
      <dl className="flex flex-col">
        {ROWS.map(({ keys, meaning }) => (
          <div key={meaning} className="flex min-h-11 items-center gap-4 border-line py-1 not-last:border-b">
            <dt className="flex w-40 shrink-0 flex-wrap gap-1.5">
              {keys.map((key) => {
                const label = typeof key === "string" ? key : text(key.key);
                return (
                  <kbd key={label} className="rounded-sm border border-line-strong bg-raised px-2 py-0.5 text-sm font-semibold numeric">
                    {label}
                  </kbd>
                );
              })}
            </dt>
            <dd>{text(meaning)}</dd>
          </div>
        ))}
      </dl>
    </Dialog>
  );
}
