import { CircleDot, Play, Square } from "lucide-react";
import { useState } from "react";
import { SERVICES } from "@/generated/graph";
import { useText } from "@/i18n/text";
import { call } from "@/robot/commands";
import { showAnswer, showDone, showProblem } from "@/state/problems";
import { Button } from "@/ui/button";
import { fixed, formatDuration } from "@/ui/numbers";
import { Panel } from "@/ui/panel";
import { Slider } from "@/ui/slider";
import { EntryMenu } from "./entry_menu";
import { type LibraryState, SPEEDS } from "./library";
import { RecordDialog, RecordingBar } from "./recorder";
import type { LibraryReading } from "./use_library";

interface SequencesPanelProps {
  reading: LibraryReading;
  state: LibraryState | null;
  isBlocked: boolean;
}

/** Recorded sequences, their replay, and the recorder. */
export function SequencesPanel({ reading, state, isBlocked }: SequencesPanelProps) {
  const text = useText();
  const [speed, setSpeed] = useState(1);
  const [isAsking, setAsking] = useState(false);
  const sequences = reading.library?.sequences ?? [];
  const names = sequences.map(({ name }) => name);
  const isBusy = state?.recording === true || state?.playing === true;

  async function play(name: string): Promise<void> {
    await showAnswer(call(SERVICES.ARM_LIBRARY_PLAY, { name, speed }, 20_000));
  }

  return (
    <Panel
      title={text("arm_sequences")}
      aside={
        <Button size="small" className="text-text" disabled={isBlocked || isBusy} onClick={() => setAsking(true)}>
          <CircleDot />
          {text("arm_record")}
        </Button>
      }
      className="min-h-56"
      bodyClassName="flex min-h-0 flex-col gap-1"
      notice={state?.aborted ? text("arm_aborted", { reason: state.aborted }) : state === null ? text("arm_library_silent") : null}
    >
      {state?.recording === true && <RecordingBar state={state} taken={names} onSaved={reading.reload} />}
      {state?.playing === true && <ReplayBar state={state} />}
      {!isBusy && (
        <div className="flex items-center gap-3">
          <span className="text-sm text-text-2">{text("arm_speed")}</span>
          <Slider
            label={text("arm_speed")}
            value={speed}
            min={SPEEDS.low}
            max={SPEEDS.high}
            step={SPEEDS.step}
            valueText={`${fixed(speed, 2)}×`}
            onChange={setSpeed}
          />
          <span className="w-[5ch] text-right font-semibold numeric">{fixed(speed, 2)}×</span>
        </div>
      )}
      {sequences.length === 0 ? (
        <p className="py-2 text-sm text-text-3">{reading.library === null ? text("arm_library_unknown") : text("arm_no_sequences")}</p>
      ) : (
        <ul className="-mx-2 min-h-0 grow overflow-y-auto">
          {sequences.map((sequence) => (
            <li key={sequence.name} className="flex items-center gap-2 rounded-md px-2 hover:bg-raised">
              <p className="min-w-0 grow wrap-anywhere">
                <span className="font-semibold">{sequence.name}</span>
                <span className="ml-2 text-xs text-text-3">
                  <span className="numeric">{formatDuration(sequence.durationS / speed)}</span> · {text("arm_points", { count: sequence.waypoints })}
                  {sequence.mode === "kinesthetic" && ` · ${text("arm_mode_kinesthetic")}`}
                </span>
              </p>
              <Button size="small" disabled={isBlocked || isBusy} onClick={() => void play(sequence.name)}>
                <Play />
                {text("arm_play")}
              </Button>
              <EntryMenu kind="sequence" name={sequence.name} taken={names} disabled={isBlocked} onChanged={reading.reload} />
            </li>
          ))}
        </ul>
      )}
      {isAsking && <RecordDialog onClose={() => setAsking(false)} />}
    </Panel>
  );
}

function ReplayBar({ state }: { state: LibraryState }) {
  const text = useText();

  async function stop(): Promise<void> {
    try {
      showDone((await call(SERVICES.ARM_LIBRARY_STOP, {}, 20_000)).message);
    } catch (error) {
      showProblem(error);
    }
  }

  return (
    <div className="rounded-md border border-alive-2 bg-alive-wash p-3">
      <div className="flex items-center gap-3">
        <p role="status" className="min-w-0 grow truncate">
          <span className="font-semibold text-alive">{text("arm_playing", { name: state.name })}</span>
          <span aria-hidden="true" className="ml-2 text-sm text-text-2 numeric">
            {formatDuration(state.elapsedS)}
          </span>
        </p>
        <Button className="h-11" onClick={() => void stop()}>
          <Square />
          {text("arm_stop_replay")}
        </Button>
      </div>
      <div
        role="progressbar"
        aria-label={text("arm_playing", { name: state.name })}
        aria-valuemin={0}
        aria-valuemax={100}
        aria-valuenow={Math.round(state.progress * 100)}
        className="mt-2 h-1.5 rounded-full bg-raised"
      >
        <div className="h-full rounded-full bg-alive transition-[width] duration-200 ease-linear" style={{ width: `${state.progress * 100}%` }} />
      </div>
    </div>
  );
}
