import { Circle, CircleCheck, MicOff, SendHorizontal } from "lucide-react";
import { useId } from "react";
import { useText } from "@/i18n/text";
import { GROUPS } from "@/shell/settings/groups";
import { SettingField } from "@/shell/settings/setting_field";
import { useSetting } from "@/state/settings";
import { Button } from "@/ui/button";
import { fixed } from "@/ui/numbers";
import { Panel } from "@/ui/panel";
import { KeyForm } from "./key_form";
import { type Requirement, requirements } from "./requirements";
import { useVoiceKey } from "./voice_key";

const SETTINGS_GROUP = GROUPS.find(({ title }) => title === "settings_voice");

/** The Voice tab, for speaking with the voice agent. Until its engine exists, the tab shows what voice needs, and its settings. */
export default function VoiceTab() {
  const { key, isKept } = useVoiceKey();
  const needs = requirements({
    hasKey: key !== "",
    isKeyKept: isKept,
    isSecure: window.isSecureContext,
    hasMicrophone: "mediaDevices" in navigator,
    hasEngine: false,
  });
  return (
    <div className="grid min-h-full grid-cols-[minmax(0,1fr)] gap-3 lg:h-full lg:min-h-[40rem] lg:grid-cols-[minmax(0,1fr)_var(--column)] lg:grid-rows-[minmax(0,1fr)]">
      <div className="flex min-h-0 flex-col gap-3">
        <Stage needs={needs} />
        <div className="grid min-h-64 grow grid-cols-[minmax(0,1fr)] gap-3 xl:grid-cols-[minmax(0,3fr)_minmax(0,2fr)]">
          <Conversation />
          <ToolCalls />
        </div>
      </div>
      <VoiceSettings />
    </div>
  );
}

function Stage({ needs }: { needs: readonly Requirement[] }) {
  const text = useText();
  const reason = useId();
  const pushToTalk = useSetting("voicePushToTalk");
  const missing = needs.filter(({ isMet }) => !isMet).length;
  return (
    <section aria-label={text("voice_stage")} className="panel grid shrink-0 items-center gap-x-10 gap-y-5 px-6 py-6 md:grid-cols-[auto_minmax(0,1fr)]">
      <div className="flex flex-col items-center gap-5">
        <Orb />
        <button
          type="button"
          aria-disabled="true"
          aria-describedby={reason}
          className="flex h-14 min-w-52 cursor-not-allowed items-center justify-center gap-3 rounded-full border border-dashed border-line-strong px-8 text-base font-semibold text-text-3"
        >
          <MicOff aria-hidden="true" className="size-5" />
          {text(pushToTalk ? "voice_hold_to_talk" : "voice_open_microphone")}
        </button>
      </div>
      <div>
        <h2 className="text-xl leading-tight font-bold">{text("voice_not_set_up")}</h2>
        <p id={reason} className="mt-1 text-text-2">
          {text("voice_missing", { count: missing })}
        </p>
        <ul className="mt-4 flex flex-col gap-3">
          {needs.map(({ title, state, isMet }) => (
            <li key={title} className="flex items-start gap-3">
              {isMet ? (
                <CircleCheck aria-label={text("voice_met")} className="mt-0.5 size-5 shrink-0 text-alive" />
              ) : (
                <Circle aria-label={text("voice_unmet")} className="mt-0.5 size-5 shrink-0 text-attention" strokeDasharray="4 3" />
              )}
              <p>
                <span className="font-semibold">{text(title)}</span>
                <span className="block text-sm text-text-2">{text(state)}</span>
              </p>
            </li>
          ))}
        </ul>
      </div>
    </section>
  );
}

/** The agent's indicator. It is idle: the page neither speaks nor listens. */
function Orb() {
  return (
    <svg viewBox="0 0 160 160" aria-hidden="true" className="size-40">
      <circle cx="80" cy="80" r="78" className="fill-none stroke-line" strokeWidth="1.5" />
      <circle cx="80" cy="80" r="62" className="fill-none stroke-line-strong" strokeWidth="1.5" strokeDasharray="3 7" />
      <circle cx="80" cy="80" r="44" className="fill-raised stroke-line-strong" strokeWidth="1.5" />
      {[-18, -9, 0, 9, 18].map((x) => (
        <line key={x} x1={80 + x} x2={80 + x} y1="77" y2="83" className="stroke-text-3" strokeWidth="3.5" strokeLinecap="round" />
      ))}
    </svg>
  );
}

function Conversation() {
  const text = useText();
  return (
    <Panel title={text("voice_conversation")} aside={text("voice_turns", { count: 0 })} tone="empty" bodyClassName="flex flex-col gap-3">
      <p className="grid min-h-24 grow place-items-center px-4 text-center text-sm">{text("voice_conversation_empty")}</p>
      <div className="flex gap-2">
        <input
          disabled
          aria-label={text("voice_write")}
          placeholder={text("voice_write")}
          className="min-h-11 min-w-0 grow cursor-not-allowed rounded-md border border-line bg-well px-3 text-sm placeholder:text-text-3"
        />
        <Button disabled size="icon" className="size-11" aria-label={text("voice_send")}>
          <SendHorizontal />
        </Button>
      </div>
    </Panel>
  );
}

function ToolCalls() {
  const text = useText();
  const linear = useSetting("voiceMaxLinearMps");
  const angular = useSetting("voiceMaxAngularRps");
  return (
    <Panel title={text("voice_tools")} aside={text("voice_calls", { count: 0 })} tone="empty" bodyClassName="flex flex-col">
      <p className="grid min-h-16 grow place-items-center px-4 text-center text-sm">{text("voice_tools_empty")}</p>
      <ul className="flex list-disc flex-col gap-1 pl-5 text-xs text-text-2">
        <li>{text("voice_rule_caps", { linear: fixed(linear, 2), angular: fixed(angular, 2) })}</li>
        <li>{text("voice_rule_control")}</li>
        <li>{text("voice_rule_stop")}</li>
      </ul>
    </Panel>
  );
}

function VoiceSettings() {
  const text = useText();
  return (
    <Panel title={text("voice_settings")} aside={text("voice_settings_shared")} bodyClassName="flex flex-col gap-3 overflow-y-auto">
      <KeyForm />
      <div className="flex flex-col gap-2 border-t border-line pt-2">
        {SETTINGS_GROUP?.names.map((name) => (
          <SettingField key={name} name={name} />
        ))}
      </div>
    </Panel>
  );
}
