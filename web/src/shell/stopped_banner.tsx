import { Octagon } from "lucide-react";
import { Fragment, useState } from "react";
import { hasControl, useConsole } from "@/api/console_store";
import { useAge } from "@/hooks/use_now";
import { useEstop } from "@/hooks/use_situation";
import { errorText } from "@/i18n/error_text";
import { namedIn } from "@/i18n/robot_words";
import { useLanguage, useText } from "@/i18n/text";
import { useIsRewound } from "@/state/rewind";
import { useLink } from "@/robot/link";
import { gate as stopGate, release, useGate, withdrawStop } from "@/robot/stop";
import { elsewhere } from "@/safety/elsewhere";
import { useTabRole } from "@/safety/commanding_tab";
import { type StopLine, stopLines } from "@/state/stop_reasons";
import { cn } from "@/ui/cn";
import { RobotWords } from "@/ui/robot_words";
import { HoldButton } from "@/ui/hold_button";
import { formatDuration } from "@/ui/numbers";

/** Why the robot is stopped, who holds it, and the release: at the far end from the stop. */
export function StoppedBanner() {
  const text = useText();
  const gate = useGate();
  const estop = useEstop();
  const state = useConsole();
  const linkOpen = useLink((link) => link.state === "open");
  const [problem, setProblem] = useState("");
  const isRewound = useIsRewound();
  const isWatching = useTabRole(({ role }) => role === "watching");
  const stopped = estop.engaged === true || state.stop.length > 0;
  const wasStopped = !stopped && estop.engaged === null && estop.lastEngaged === true;
  // While the page is rewound, its own gate says nothing: it sends no command anyway.
  if (!linkOpen || state.session === null || (!stopped && (isRewound || (!gate.engaged && !wasStopped)))) return null;

  const lines = stopLines({
    own: gate.isStated && gate.reason !== null ? { press: stopGate.press, key: `reason_${gate.reason}`, ageS: null } : null,
    name: state.session.name,
    server: state.stop,
    robot: estop.reasons,
  });
  const holder = state.control.holder;
  const mayRelease = state.session.role === "operator" && (holder === null || hasControl(state)) && !isWatching;

  const closedBy = gate.reason === "startup" || gate.reason === "user" ? null : gate.reason;
  const sinceMs = stopped ? null : wasStopped ? estop.receivedMs : closedBy === null ? null : gate.sinceMs;

  async function tryRelease(): Promise<void> {
    try {
      await release();
      setProblem("");
    } catch (error) {
      setProblem(errorText(error));
    }
  }

  return (
    <div
      role="status"
      className={cn(
        "flex min-h-14 shrink-0 flex-wrap items-center gap-x-4 gap-y-2 border-b px-4 py-2",
        stopped ? "border-stop bg-stop text-white" : "border-line bg-panel",
      )}
    >
      <HoldButton onHeld={() => void tryRelease()} disabled={!mayRelease || isRewound} data-testid="release">
        {text(stopped || wasStopped ? "hold_to_release" : "hold_to_start")}
      </HoldButton>
      <Octagon aria-hidden="true" className={cn("shrink-0", stopped ? "size-8" : "size-6 text-text-3")} />
      <p className="min-w-0 grow basis-60">
        <strong className={stopped ? "text-lead leading-tight font-bold max-md:text-base" : "font-semibold"}>
          {stopped ? <StopLines lines={lines} ownSinceMs={gate.sinceMs} /> : wasStopped ? text("was_stopped") : closedBy === null ? text("cannot_drive_yet") : text("page_cannot_drive", { reason: text(`reason_${closedBy}`) })}
        </strong>
        {sinceMs !== null && (
          <span aria-hidden="true" className="ml-2 text-text-2 tabular-nums" data-testid="stop-age">
            <Age atMs={sinceMs} />
          </span>
        )}
        <span className={cn("block text-xs", stopped ? "text-white" : "text-text-2")}>
          {problem !== ""
            ? text("release_failed", { reason: problem })
            : mayRelease
              ? text(stopped || wasStopped ? "nothing_moves_after_release" : "cannot_drive_yet_hint")
              : elsewhere() !== null && !gate.isStated ? text("elsewhere_no_command") : text(gate.isStated ? "release_needs_withdrawal" : stopped || wasStopped ? "release_needs_control" : "driving_needs_control", { holder: isWatching ? text("other_tab") : (holder ?? text("who_has_control")) })}{" "}
          {lines.some(({ name }) => name !== null) && text("this_browser_is", { name: state.session.name })}
        </span>
      </p>
      {gate.isStated && !mayRelease && (
        <HoldButton tone="dark" disabled={isRewound} onHeld={withdrawStop}>
          {text("hold_to_withdraw")}
        </HoldButton>
      )}
    </div>
  );
}

/** Every cause of the stop with its age, which is not read out: it changes all the time. */
function StopLines({ lines, ownSinceMs }: { lines: readonly StopLine[]; ownSinceMs: number }) {
  const text = useText();
  const language = useLanguage((store) => store.language);
  return (
    <>
      {text("stopped_prefix")}
      {lines.map((line, index) => (
        <Fragment key={`${line.key ?? line.words} ${line.values["name"] ?? ""}`}>
          {index > 0 ? "; " : line.key !== null && BY.test(line.key) ? " " : ": "}
          {line.key === null ? <RobotWords words={line.words} /> : text(line.key, namedIn(language, line.values))}
          {line.name !== null && (
            <span aria-hidden="true" className="font-normal tabular-nums" data-testid="stop-age">
              , {line.ageS === null ? <Age atMs={ownSinceMs} /> : text("ago", { age: formatDuration(line.ageS) })}
            </span>
          )}
        </Fragment>
      ))}
    </>
  );
}

/** The texts that go on the sentence. */
const BY = /^(reason_user|reason_voice-agent|held_(pressed|left|lost_holding))/;

/** How long ago something was; a text of its own, so that it alone is drawn four times a second. */
function Age({ atMs }: { atMs: number }) {
  const text = useText();
  return text("ago", { age: formatDuration(useAge(atMs)) });
}
