import { AudioLines, CircleAlert, Hourglass, Mic, MicOff, OctagonX, Play, ShieldAlert, Square, Unplug, Volume2 } from "lucide-react";
import type { ComponentType } from "react";
import { useIsLinkLost } from "@/hooks/use_situation";
import { errorText } from "@/i18n/error_text";
import { type Text, useText } from "@/i18n/text";
import { showProblem } from "@/state/problems";
import { changeSettings, useSetting } from "@/state/settings";
import { Announced } from "@/ui/announced";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { fixed } from "@/ui/numbers";
import { RobotWords } from "@/ui/robot_words";
import { Segments } from "@/ui/segments";
import { type Credential, useCredential } from "./credentials";
import { TalkButton } from "./talk_button";
import { type TalkMode, endTalk, endVoice, interruptAgent, startVoice, talkMode } from "./voice_session";
import { type VoiceView, useVoice } from "./voice_store";
import { type VoiceState, voiceState } from "./view_state";

interface Look {
  icon: ComponentType<{ className?: string }>;
  tone: string;
}

const LOOKS: Record<VoiceState, Look> = {
  off: { icon: Mic, tone: "text-text-2" },
  scripted_only: { icon: MicOff, tone: "text-text-3" },
  failed: { icon: CircleAlert, tone: "text-attention" },
  connecting: { icon: Hourglass, tone: "text-text-2" },
  link_lost: { icon: Unplug, tone: "text-text-3" },
  refused: { icon: ShieldAlert, tone: "text-attention" },
  hearing: { icon: AudioLines, tone: "text-sensed" },
  thinking: { icon: Hourglass, tone: "text-alive" },
  speaking: { icon: Volume2, tone: "text-alive" },
  stopped: { icon: OctagonX, tone: "text-stop-text" },
  listening: { icon: Mic, tone: "text-alive" },
  typing: { icon: MicOff, tone: "text-text-2" },
};

/** What the agent does now, and the buttons to talk, to interrupt, to start and to end. */
export function StatePanel({ isStopped, isClosed }: { isStopped: boolean; isClosed: boolean }) {
  const text = useText();
  const view = useVoice();
  const by = useCredential();
  const isLinkLost = useIsLinkLost();
  const mode = talkMode(useSetting("voicePushToTalk"), useSetting("voiceVadEnabled"));
  const state = voiceState({ view, hasKey: by !== "script", isStopped, isLinkLost });
  const { icon: Icon, tone } = LOOKS[state];
  const isOn = view.session !== "off";
  // A script hears nothing, so an open microphone makes no turns; the button does.
  const canHold = isOn && ((view.microphone === "on" && !view.isTypedOnly) || view.isScripted);
  const shownMode = view.isScripted && mode === "open" ? "hold" : mode;

  return (
    <section aria-label={text("voice_stage")} data-testid="voice-state" data-state={state} className="panel flex flex-col gap-4 p-4 md:p-5">
      <div className="flex items-start gap-4 max-md:flex-wrap">
        <Icon aria-hidden="true" className={cn("mt-0.5 size-9 shrink-0", tone)} />
        <div className="min-w-0 grow max-md:basis-52">
          <h2 className={cn("text-xl leading-tight font-bold", tone)}>
            <Announced says={text(`voice_state_${state}`)}>{text(`voice_state_${state}`)}</Announced>
          </h2>
          <p className="mt-1 text-text-2">
            <About state={state} by={by} mode={shownMode} view={view} text={text} />
          </p>
          {isOn && isClosed && !isStopped && <p className="mt-1 text-sm text-attention">{text("voice_closed")}</p>}
          {isOn && view.microphone === "on" && <StopsHeard view={view} text={text} />}
          {isOn && view.microphoneProblem !== null && <p className="mt-1 text-sm text-attention">{errorText(view.microphoneProblem)}</p>}
        </div>
        {view.latency !== null && <LatencyOf latency={view.latency} text={text} />}
      </div>
      {canHold && <Loudness isShown={view.microphone === "on"} />}
      <div className="flex flex-wrap items-center gap-3">
        {isOn ? (
          <>
            {canHold && shownMode !== "open" && <TalkButton mode={shownMode} />}
            <Button disabled={!view.isAgentSpeaking && !view.isThinking} onClick={interruptAgent}>
              <Square />
              {text("voice_interrupt")}
            </Button>
            <Button kind="quiet" title={text("voice_ends_with_tab")} onClick={endVoice}>
              {text("voice_end")}
            </Button>
          </>
        ) : (
          <Button kind="primary" className="h-14 px-8 text-base max-md:w-full" disabled={isLinkLost} onClick={() => startVoice(by)}>
            <Play />
            {text(by === "script" ? "voice_start_script" : "voice_start")}
          </Button>
        )}
        <Segments<"hold" | "open">
          label={text("voice_mode")}
          value={mode === "hold" ? "hold" : "open"}
          onChange={(next) => {
            endTalk();
            changeSettings({ voicePushToTalk: next === "hold" }).catch(showProblem);
          }}
          options={[
            { value: "hold", label: text("voice_mode_hold") },
            { value: "open", label: text("voice_mode_open") },
          ]}
          className="ml-auto max-md:ml-0"
        />
      </div>
    </section>
  );
}

function About({ state, by, mode, view, text }: { state: VoiceState; by: Credential; mode: TalkMode; view: VoiceView; text: Text }) {
  if (state === "failed") return view.failure === null ? null : errorText(view.failure);
  if (state === "hearing") return text(`voice_about_hearing_${mode}`);
  if (state === "listening") return text(`voice_about_listening_${mode}`);
  if (state === "typing" && view.isTypedOnly) return text("voice_about_typing_only");
  if (state === "off" && by === "offline") return text("voice_about_off_offline");
  if (state === "speaking" && by === "offline" && mode === "open") return text("voice_about_speaking_offline");
  if (state === "thinking" && by === "offline") return text("voice_about_thinking_offline");
  if (state !== "refused") return text(`voice_about_${state}`);
  const [before = "", after = ""] = text("voice_about_refused", { reason: "\n" }).split("\n");
  return (
    <>
      {before}
      <RobotWords words={view.console?.cutOff ?? ""} />
      {after}
    </>
  );
}

/** Whether a word for stopping is heard at once, or why not. */
function StopsHeard({ view, text }: { view: VoiceView; text: Text }) {
  const { state, reason } = view.console?.listener ?? { state: "off" as const, reason: "" };
  const isHeard = state === "ready";
  return (
    <p data-testid="voice-stops" data-state={state} className={cn("mt-1 text-sm", isHeard || state === "starting" ? "text-text-2" : "text-attention")}>
      {text(`voice_stops_${state}`)} {(state === "failed" || state === "busy") && <RobotWords words={reason} />}
    </p>
  );
}

function LatencyOf({ latency, text }: { latency: NonNullable<VoiceView["latency"]>; text: Text }) {
  const rows = [
    { label: text("voice_latency_sound"), ms: latency.soundMs },
    { label: text("voice_latency_call"), ms: latency.callMs },
  ];
  return (
    <dl aria-label={text("voice_latency")} data-testid="voice-latency" className="shrink-0 text-right text-xs text-text-3 max-md:flex max-md:basis-full max-md:gap-4">
      {rows.map(({ label, ms }) => (
        <div key={label} className="flex items-baseline justify-end gap-2">
          <dt>{label}</dt>
          <dd className="text-sm text-text numeric">
            {fixed(ms === null ? null : ms / 1000, 2)} <span className="text-text-3">s</span>
          </dd>
        </div>
      ))}
    </dl>
  );
}

/** Speech is at about a fifth of the full scale. */
const SHOWN_LOUDNESS = 0.25;

/** How loud the microphone is, with the mark at which a turn begins. */
function Loudness({ isShown }: { isShown: boolean }) {
  const loudness = useVoice((view) => view.loudness);
  const threshold = useSetting("voiceVadStartThreshold");
  if (!isShown) return null;
  const share = (value: number) => `${Math.min(100, (100 * value) / SHOWN_LOUDNESS)}%`;
  return (
    <div aria-hidden="true" className="relative h-1.5 overflow-hidden rounded-full bg-well">
      <div className="h-full bg-sensed" style={{ width: share(loudness) }} />
      <div className="absolute inset-y-0 w-0.5 bg-text-2" style={{ left: share(threshold) }} />
    </div>
  );
}
