import { History, Pause, Play, Radio, RotateCcw, RotateCw } from "lucide-react";
import { useEffect } from "react";
import { useNow } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import { robotTime } from "@/robot/link";
import { showProblem } from "@/state/problems";
import { useRoute } from "@/state/route";
import { Button } from "@/ui/button";
import { isShortcut } from "@/ui/keyboard";
import { isDialogOpen } from "@/ui/open_dialogs";
import { formatDuration, writeMoment } from "@/ui/numbers";
import { Slider } from "@/ui/slider";
import { goLive, hasPast, rewind, setPlaying, showAt } from "./rewind";
import { isRewound, useIsRewound, useRewind } from "@/state/rewind";

const JUMP_S = 10;
const STEP_S = 0.1;

/** The button that rewinds the views of a tab. */
export function RewindButton({ className }: { className?: string }) {
  const text = useText();
  const isOn = useIsRewound();
  return (
    <Button onClick={() => (isOn ? goLive() : void begin())} aria-pressed={isOn} title={text("rewind_hint")} {...(className === undefined ? {} : { className })} data-testid="rewind">
      <History />
      {text("rewind")}
    </Button>
  );
}

async function begin(): Promise<void> {
  await rewind().catch(showProblem);
}

/** R rewinds, and goes further back; L is the way back to live. Called once. */
export function useRewindKeys(): void {
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      if (!isShortcut(event) || isDialogOpen()) return;
      // By the key's place, as all letters of the page.
      if (event.code === "KeyL") goLive();
      else if (event.code === "KeyR" && isRewound()) jump(-JUMP_S);
      else if (event.code === "KeyR" && hasPast(useRoute.getState().tab)) void begin();
    };
    window.addEventListener("keydown", onKey);
    return () => window.removeEventListener("keydown", onKey);
  }, []);
}

function jump(seconds: number): void {
  const { shownS } = useRewind.getState();
  if (shownS !== null) showAt(shownS + seconds);
}

/** That the views show the past, which moment of it, and the way back: above them, while they do. */
export function RewindBar() {
  const isShown = useIsRewound();
  return isShown ? <Bar /> : null;
}

function Bar() {
  const text = useText();
  const { shownS, extent, isPlaying, isLoading, problem } = useRewind();
  const now = useNow();
  if (shownS === null || extent === null) return null;
  const nowS = robotTime(now) ?? extent.endS;
  const age = formatDuration(Math.max(0, nowS - shownS));
  const moment = writeMoment(shownS);
  return (
    <section aria-label={text("rewind_title")} data-testid="rewind-bar" className="flex shrink-0 flex-wrap items-center gap-x-4 gap-y-1 border-b-2 border-attention bg-panel px-4 py-2 max-md:px-3">
      <Button kind="primary" onClick={goLive} data-testid="go-live">
        <Radio />
        {text("rewind_live")}
        <kbd aria-hidden="true" className="rounded-sm border border-alive-ink/40 px-1.5 text-xs pointer-coarse:hidden">
          {text("rewind_live_key")}
        </kbd>
      </Button>
      <p role="status" className="flex items-baseline gap-2 whitespace-nowrap">
        <strong className="font-bold text-attention uppercase">{text("rewind_not_live")}</strong>
        <span aria-hidden="true" className="text-lead font-bold numeric">
          {moment}
        </span>
      </p>
      <p className="text-sm whitespace-nowrap text-text-2 numeric">{text("rewind_ago", { age })}</p>
      <div className="flex min-w-60 grow basis-80 items-center gap-1">
        <Button kind="quiet" size="icon" aria-label={text("rewind_back")} title={text("rewind_back")} onClick={() => jump(-JUMP_S)}>
          <RotateCcw />
        </Button>
        <Button kind="quiet" size="icon" aria-label={text(isPlaying ? "rewind_pause" : "rewind_play")} onClick={() => setPlaying(!isPlaying)} data-testid="rewind-play">
          {isPlaying ? <Pause /> : <Play />}
        </Button>
        <Button kind="quiet" size="icon" aria-label={text("rewind_forward")} title={text("rewind_forward")} onClick={() => jump(JUMP_S)}>
          <RotateCw />
        </Button>
        <Slider
          label={text("rewind_moment")}
          value={shownS}
          min={extent.startS}
          max={Math.max(extent.endS, extent.startS + STEP_S)}
          step={STEP_S}
          valueText={`${moment}, ${text("rewind_ago", { age })}`}
          onChange={showAt}
          className="mx-2"
        />
      </div>
      <p className="basis-full text-xs text-text-2">
        {problem !== "" ? <span role="alert" className="text-attention">{text("rewind_problem", { reason: problem })}</span> : isLoading ? text("rewind_loading") : text("rewind_explained")}
      </p>
    </section>
  );
}
