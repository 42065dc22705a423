import { useState } from "react";
import { type Finding, type Fix, hasControl, useConsole } from "@/api/console_store";
import { errorText } from "@/i18n/error_text";
import { TEXT_KEYS, type Text, type TextKey, useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { CommandLine } from "@/ui/command_line";
import { type PlayResult, type PlayStep, changesOf } from "./diagnosis";
import { playFix } from "./requests";

/** The fix of a finding: first what it would change, then the button that changes it. */
export function FixPanel({ finding }: { finding: Finding }) {
  const text = useText();
  const state = useConsole();
  const [result, setResult] = useState<PlayResult | null>(null);
  const [problem, setProblem] = useState("");
  const { fix } = finding;
  const busy = state.doctor.busy !== "";
  const mayFix = state.session?.role === "operator" && (state.control.holder === null || hasControl(state));
  const hasPreview = result !== null && result.dry_run && result.state === "done";

  async function play(confirmed: boolean): Promise<void> {
    try {
      setProblem("");
      setResult(await playFix(finding.id, confirmed));
    } catch (error) {
      setProblem(errorText(error));
    }
  }

  if (fix.playbook === null) {
    return (
      <div className="flex flex-col gap-1">
        <p className="text-xs text-text-3">{text("doctor_by_hand")}</p>
        <ByHand fix={fix} />
      </div>
    );
  }
  return (
    <div className="flex flex-col gap-2">
      <ByHand fix={fix} />
      {result !== null && <Outcome result={result} />}
      {problem !== "" && (
        <p role="alert" className="text-attention">
          {problem}
        </p>
      )}
      <div className="flex flex-wrap items-center gap-3">
        {hasPreview && changesOf(result) > 0 ? (
          <Button kind="primary" disabled={busy || !mayFix} onClick={() => void play(true)}>
            {text("doctor_fix")}
          </Button>
        ) : (
          <Button disabled={busy || !mayFix} onClick={() => void play(false)}>
            {text("doctor_preview")}
          </Button>
        )}
        <p className={cn("min-w-0 grow basis-40 text-xs", fix.safe || !mayFix ? "text-text-3" : "text-attention")}>
          {text(!mayFix ? "doctor_fix_needs_control" : fix.safe ? "doctor_fix_safe" : "doctor_fix_unsafe")}
        </p>
      </div>
    </div>
  );
}

function ByHand({ fix }: { fix: Fix }) {
  return (
    <>
      {fix.instruction !== "" && <p>{fix.instruction}</p>}
      {fix.command !== "" && <CommandLine command={fix.command} />}
    </>
  );
}

function Outcome({ result }: { result: PlayResult }) {
  const text = useText();
  const count = changesOf(result);
  const total = result.steps.length;
  const failed = result.state !== "done";
  const sentence = failed
    ? text("doctor_play_failed", { playbook: result.playbook, state: result.state, message: result.message })
    : !result.dry_run
      ? text("doctor_changed", { count, total })
      : count > 0
        ? text("doctor_would_change", { count, total })
        : text("doctor_would_not_change");
  return (
    <div role="status" className="flex flex-col gap-2 rounded-md bg-well px-3 py-2">
      <p className={cn("font-semibold", failed ? "text-stop-text" : "text-text")}>{sentence}</p>
      <ol className="flex flex-col gap-1.5">
        {result.steps.map((step, index) => (
          <li key={index} className="text-xs">
            <p className="flex gap-3">
              <span className="min-w-0 grow">{step.name}</span>
              <span className="shrink-0 text-text-3">{step.machine}</span>
              <span className={cn("w-24 shrink-0 text-right", toneOf(step))}>{stepState(step, text)}</span>
            </p>
            {(step.diff !== "" || step.error !== "") && (
              <pre className="mt-0.5 overflow-x-auto whitespace-pre-wrap text-text-2 numeric">{step.error !== "" ? step.error : step.diff}</pre>
            )}
          </li>
        ))}
      </ol>
      {result.next_command !== "" && <p className="text-attention">{text("doctor_next", { command: result.next_command })}</p>}
    </div>
  );
}

function toneOf({ state }: PlayStep): string {
  if (state === "failed" || state === "lost") return "text-stop-text";
  return state === "changed" || state === "would-change" ? "text-attention" : "text-text-3";
}

function stepState({ state }: PlayStep, text: Text): string {
  const key = `doctor_step_${state}`;
  return (TEXT_KEYS as readonly string[]).includes(key) ? text(key as TextKey) : state;
}
