import { Circle, CircleCheck, MicOff } from "lucide-react";
import { useText } from "@/i18n/text";
import { useSetting } from "@/state/settings";
import { fixed } from "@/ui/numbers";
import { KeyForm } from "./key_form";
import { type Requirement, requirements } from "./requirements";
import { useVoiceKey } from "./voice_key";

/** The Voice tab. Until the page has an engine that speaks with the voice agent, it is one card: what voice needs, and what it may do. */
export default function VoiceTab() {
  const text = useText();
  const { key, isKept } = useVoiceKey();
  const linear = useSetting("voiceMaxLinearMps");
  const angular = useSetting("voiceMaxAngularRps");
  const needs = requirements({
    hasKey: key !== "",
    isKeyKept: isKept,
    isSecure: window.isSecureContext,
    hasMicrophone: "mediaDevices" in navigator,
    hasEngine: false,
  });
  return (
    <section aria-label={text("voice_stage")} className="panel mx-auto flex max-w-2xl flex-col gap-6 p-6">
      <header className="flex items-start gap-4">
        <MicOff aria-hidden="true" className="mt-1 size-8 shrink-0 text-text-3" />
        <div>
          <h2 className="text-xl leading-tight font-bold">{text("voice_not_set_up")}</h2>
          <p className="mt-1 text-text-2">{text("voice_missing", { count: needs.filter(({ isMet }) => !isMet).length })}</p>
        </div>
      </header>
      <ul className="flex flex-col gap-3">
        {needs.map((need) => (
          <Need key={need.title} {...need} />
        ))}
      </ul>
      <KeyForm />
      <ul className="flex list-disc flex-col gap-1 border-t border-line pt-4 pl-5 text-text-2">
        <li>{text("voice_rule_caps", { linear: fixed(linear, 2), angular: fixed(angular, 2) })}</li>
        <li>{text("voice_rule_control")}</li>
        <li>{text("voice_rule_stop")}</li>
      </ul>
    </section>
  );
}

function Need({ title, state, isMet }: Requirement) {
  const text = useText();
  return (
    <li className="flex items-start gap-3">
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
  );
}
