import { Ban, Check, CircleHelp, CircleSlash, LoaderCircle } from "lucide-react";
import { type ComponentType, Fragment } from "react";
import { useText } from "@/i18n/text";
import { cn } from "@/ui/cn";
import { Panel } from "@/ui/panel";
import { RobotWords } from "@/ui/robot_words";
import { ScrollRegion } from "@/widgets/scroll_region";
import { describeArguments, describeResult, sentencesOf } from "./call_text";
import { type CallRow, useVoice } from "./voice_store";

const LOOKS: Record<CallRow["state"], { icon: ComponentType<{ className?: string }>; tone: string }> = {
  running: { icon: LoaderCircle, tone: "text-sensed" },
  done: { icon: Check, tone: "text-alive" },
  refused: { icon: Ban, tone: "text-attention" },
  read_back: { icon: CircleHelp, tone: "text-attention" },
  cancelled: { icon: CircleSlash, tone: "text-text-3" },
};

/** The tools that were called, the newest first, with what came of them. */
export function CallList() {
  const text = useText();
  const calls = useVoice((view) => view.calls);
  return (
    <Panel title={text("voice_calls")} aside={calls.length > 0 && <span className="numeric">{calls.length}</span>} className="lg:min-h-52 lg:shrink lg:grow" bodyClassName="flex min-h-0 flex-col">
      {calls.length === 0 ? (
        <p className="py-2 text-text-3">{text("voice_calls_empty")}</p>
      ) : (
        <ScrollRegion aria-label={text("voice_calls_list")} className="-mx-2 min-h-0 grow px-2 max-lg:max-h-80">
          <ol className="flex flex-col">
            {calls.toReversed().map((call) => (
              <Row key={call.id} call={call} />
            ))}
          </ol>
        </ScrollRegion>
      )}
    </Panel>
  );
}

function Row({ call }: { call: CallRow }) {
  const text = useText();
  const { icon: Icon, tone } = LOOKS[call.state];
  return (
    <li className="flex items-start gap-3 border-line py-2 not-last:border-b">
      <Icon aria-hidden="true" className={cn("mt-0.5 size-4 shrink-0", tone)} />
      <div className="min-w-0 grow">
        <p className="flex flex-wrap items-baseline gap-x-2">
          <span lang="en" className="font-semibold numeric">
            {call.tool}
          </span>
          <span className={cn("text-xs", tone)}>{text(`voice_call_${call.state}`)}</span>
          {call.byOperator && <span className="text-xs text-text-3">{text("voice_call_by_you")}</span>}
        </p>
        <p lang="en" className="text-xs break-words text-text-3 numeric">
          {describeArguments(call.args)}
        </p>
        {call.result !== null && (
          <p className="text-sm break-words text-text-2">
            {call.state === "done" ? (
              <span lang="en" className="numeric">
                {describeResult(call)}
              </span>
            ) : (
              sentencesOf(call).map((words, index) => (
                <Fragment key={words}>
                  {index > 0 && "; "}
                  <RobotWords words={words} />
                </Fragment>
              ))
            )}
          </p>
        )}
      </div>
    </li>
  );
}
