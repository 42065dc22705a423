import { type UIEvent, useEffect, useRef } from "react";
import { useText } from "@/i18n/text";
import { useSetting } from "@/state/settings";
import { cn } from "@/ui/cn";
import { Panel } from "@/ui/panel";
import { RobotWords } from "@/ui/robot_words";
import { ScrollRegion } from "@/widgets/scroll_region";
import { useCredential } from "./credentials";
import { type Entry, useVoice } from "./voice_store";

const NEAR_END_PX = 24;

/** What was said; its end stays in view while the operator is there. */
export function Transcript() {
  const text = useText();
  const entries = useVoice((view) => view.transcript);
  const frame = useRef<HTMLDivElement>(null);
  const isAtEnd = useRef(true);
  // After every rendering: each is a change of what was said.
  useEffect(() => {
    if (frame.current !== null && isAtEnd.current) frame.current.scrollTop = frame.current.scrollHeight;
  });

  function noteScroll({ currentTarget }: UIEvent<HTMLDivElement>): void {
    isAtEnd.current = currentTarget.scrollHeight - currentTarget.scrollTop - currentTarget.clientHeight < NEAR_END_PX;
  }

  return (
    <Panel title={text("voice_transcript")} className="min-h-52 grow lg:min-h-28" bodyClassName="flex min-h-0 flex-col">
      {entries.length === 0 ? (
        <p className="py-2 text-text-3">{text("voice_transcript_empty")}</p>
      ) : (
        <ScrollRegion ref={frame} onScroll={noteScroll} aria-label={text("voice_transcript_list")} aria-live="polite" className="-mx-2 min-h-0 grow px-2 max-lg:max-h-80">
          <ol className="flex flex-col gap-3 py-1">
            {entries.map((entry) => (
              <Line key={entry.number} entry={entry} />
            ))}
          </ol>
        </ScrollRegion>
      )}
    </Panel>
  );
}

function Line({ entry: { who, text: words } }: { entry: Entry }) {
  const text = useText();
  const isScripted = useVoice((view) => view.isScripted);
  const spoken = useSetting("voiceLanguage");
  const by = useCredential();
  // A script speaks the language of the page. The console's grammar answers in English.
  const isOfConsole = !isScripted && by === "offline" && who === "agent";
  const language = isScripted || isOfConsole ? undefined : spoken;
  return (
    <li className={cn("max-w-[46rem] border-l-2 pl-3", who === "operator" ? "border-sensed" : who === "page" ? "border-attention" : "border-alive")}>
      <span className="block text-xs text-text-3">{text(`voice_who_${who}`)}</span>
      <span lang={who === "page" ? undefined : language} className={cn("text-base break-words whitespace-pre-wrap", who === "page" && "text-sm text-text-2")}>
        {words === "" ? "…" : isOfConsole ? <RobotWords words={words} /> : words}
      </span>
    </li>
  );
}
