import { Circle, CircleCheck, Settings2 } from "lucide-react";
import { IS_MOCK } from "@/environment";
import { errorText } from "@/i18n/error_text";
import { useText } from "@/i18n/text";
import { showOverlay } from "@/state/overlays";
import { showProblem } from "@/state/problems";
import { changeSettings, useSetting } from "@/state/settings";
import { fixed } from "@/ui/numbers";
import { Button } from "@/ui/button";
import { Panel } from "@/ui/panel";
import { offersMicrophone } from "./audio/microphone";
import { useConsoleKey, useCredential } from "./credentials";
import { KeyForm } from "./key_form";
import { MODEL_NAMES } from "./live/models";
import { type Requirement, requirements } from "./requirements";
import { useVoiceKey } from "./voice_key";
import { useVoice } from "./voice_store";

const SELECT = "min-h-10 min-w-0 rounded-md border border-line-strong bg-well px-2 text-text max-xl:min-h-11 disabled:text-text-3";

/** What voice needs, by which model and in which language it speaks, and what it may do. */
export function SetupPanel() {
  const text = useText();
  const by = useCredential();
  const isKeyKept = useVoiceKey((store) => store.isKept);
  const problem = useConsoleKey((store) => store.problem);
  const engine = useSetting("voiceEngine");
  const model = useSetting("geminiModel");
  const language = useSetting("voiceLanguage");
  const linear = useSetting("voiceMaxLinearMps");
  const angular = useSetting("voiceMaxAngularRps");
  const state = useVoice((view) => view.console);
  const needs = requirements({ by, isKeyKept, isSecure: window.isSecureContext, hasMicrophone: offersMicrophone() });
  const limits = { linear: fixed(state?.maxLinearMps ?? linear, 2), angular: fixed(state?.maxAngularRps ?? angular, 2) };
  const isOn = useVoice((view) => view.session !== "off");
  const rows = [
    { label: text("voice_language"), value: language },
    { label: text("voice_limits"), value: text("voice_limits_value", limits) },
  ];
  return (
    <Panel title={text("voice_setup")} className="shrink-0" bodyClassName="flex flex-col gap-4">
      <label className="flex items-center gap-3 text-text-2">
        <span className="grow">{text("setting_voiceEngine")}</span>
        <select
          value={engine}
          disabled={isOn}
          onChange={(event) => {
            changeSettings({ voiceEngine: event.target.value as typeof engine }).catch(showProblem);
          }}
          className={SELECT}
        >
          <option value="auto">{text("choice_auto")}</option>
          <option value="offline">{text("voice_engine_offline")}</option>
        </select>
      </label>
      <label className="flex items-center gap-3 text-text-2">
        <span className="grow">{text("voice_model")}</span>
        <select
          value={model}
          disabled={isOn || by === "offline"}
          onChange={(event) => {
            changeSettings({ geminiModel: event.target.value }).catch(showProblem);
          }}
          className={SELECT}
        >
          {/* The settings take any name, also of a model that is newer than this page. */}
          {(MODEL_NAMES.includes(model) ? MODEL_NAMES : [model, ...MODEL_NAMES]).map((name) => (
            <option key={name} value={name}>
              {name.replace(/^models\//, "")}
            </option>
          ))}
        </select>
      </label>
      <dl className="flex flex-col">
        {rows.map(({ label, value }) => (
          <div key={label} className="flex items-baseline gap-3 border-line py-1.5 not-last:border-b">
            <dt className="grow text-text-2">{label}</dt>
            <dd className="min-w-0 text-right break-words numeric">{value}</dd>
          </div>
        ))}
      </dl>
      <ul className="flex flex-col gap-3">
        {needs.map((need) => (
          <Need key={need.title} {...need} />
        ))}
      </ul>
      {problem !== null && <p className="text-sm break-words text-attention">{text("voice_key_problem", { reason: errorText(problem) })}</p>}
      <Button className="self-start" onClick={() => showOverlay("settings")}>
        <Settings2 />
        {text("voice_more_settings")}
      </Button>
      <ul className="flex list-disc flex-col gap-1 pl-5 text-sm text-text-2">
        <li>{text("voice_rule_control")}</li>
        <li>{text("voice_rule_stop")}</li>
      </ul>
      {by !== "console" && !IS_MOCK && <KeyForm />}
    </Panel>
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
