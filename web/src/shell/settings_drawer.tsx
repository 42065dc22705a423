import { ChevronDown, Keyboard, QrCode, ScrollText, Search, Stethoscope } from "lucide-react";
import { LANGUAGES, setLanguage, useLanguage, useText } from "@/i18n/text";
import { showProblem } from "@/state/problems";
import { useSettingsPlace } from "@/state/settings";
import { localStorageOrNull } from "@/storage";
import { Button } from "@/ui/button";
import { Dialog } from "@/ui/dialog";
import { Segments } from "@/ui/segments";
import { showOverlay, useOverlayState } from "@/state/overlays";
import { GROUPS, type Group } from "./settings/groups";
import { PublishLog } from "./settings/publish_log";
import { SettingField } from "./settings/setting_field";

/** Every setting, for all browsers, and what belongs to this one. */
export default function SettingsDrawer() {
  const text = useText();
  const [isOpen, setOpen] = useOverlayState("settings");
  const language = useLanguage((state) => state.language);
  return (
    <Dialog open={isOpen} onOpenChange={setOpen} title={text("settings")} description={text("settings_shared")} drawer>
      <div className="flex flex-col gap-6">
        <Place />
        <div className="flex flex-wrap items-center gap-3">
          <p className="grow">
            {text("settings_language")}
            <span className="block text-xs text-text-3">{text("settings_language_hint")}</span>
          </p>
          <Segments label={text("settings_language")} value={language} options={LANGUAGES} onChange={(next) => void setLanguage(next).catch(showProblem)} />
        </div>
        {GROUPS.map((group) => (
          <SettingsGroup key={group.title} group={group} />
        ))}
        <PublishLog />
        <div className="flex flex-wrap gap-2 border-t border-line pt-4">
          <Button onClick={() => showOverlay("palette")}>
            <Search />
            {text("palette")}
          </Button>
          <Button onClick={() => showOverlay("doctor")}>
            <Stethoscope />
            {text("doctor")}
          </Button>
          <Button onClick={() => showOverlay("runs")}>
            <ScrollText />
            {text("settings_runs")}
          </Button>
          <Button onClick={() => showOverlay("share")}>
            <QrCode />
            {text("settings_share")}
          </Button>
          <Button onClick={() => showOverlay("keys")}>
            <Keyboard />
            {text("settings_keys")}
          </Button>
        </div>
      </div>
    </Dialog>
  );
}

function SettingsGroup({ group: { title, names, folded = false } }: { group: Group }) {
  const text = useText();
  return (
    <details open={!folded} className="group flex flex-col">
      <summary className="flex min-h-11 cursor-pointer list-none items-center gap-2 border-b border-line text-sm font-semibold text-text-2 hover:text-text">
        <ChevronDown aria-hidden="true" className="size-4 -rotate-90 transition-transform group-open:rotate-0" />
        {text(title)}
        <span className="ml-auto text-xs font-normal text-text-3 numeric">{names.length}</span>
      </summary>
      <div className="flex flex-col gap-2 pt-3">
        {names.map((name) => (
          <SettingField key={name} name={name} />
        ))}
      </div>
    </details>
  );
}

/** Where changes are kept, if that is not for all browsers. */
function Place() {
  const text = useText();
  const { place, reason } = useSettingsPlace();
  const message =
    place === "page"
      ? text("settings_not_kept", { reason })
      : place === "browser"
        ? text("settings_kept_here", { reason })
        : localStorageOrNull() === null
          ? text("settings_storage_forbidden")
          : null;
  if (message === null) return null;
  return (
    <p role="status" className="rounded-md bg-attention-wash px-4 py-3 text-attention">
      {message}
    </p>
  );
}
