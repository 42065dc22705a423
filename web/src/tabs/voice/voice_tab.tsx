import { useEffect } from "react";
import { useEstop } from "@/hooks/use_situation";
import { useGate } from "@/robot/stop";
import { CallList } from "./call_list";
import { loadConsoleKey } from "./credentials";
import { ReadBackCard } from "./read_back_card";
import { SayForm } from "./say_form";
import { ScriptBanner } from "./script_banner";
import { SetupPanel } from "./setup_panel";
import { StatePanel } from "./state_panel";
import { Transcript } from "./transcript";
import { endVoice, silenceAgent } from "./voice_session";

/** The Voice tab: what the agent does now, what was said, and what its tools have done. */
export default function VoiceTab() {
  const isClosed = useGate((gate) => gate.engaged);
  const isStopped = useEstop().engaged === true;
  useEffect(() => {
    void loadConsoleKey();
    return endVoice;
  }, []);
  useEffect(() => {
    if (isStopped || isClosed) silenceAgent();
  }, [isStopped, isClosed]);

  return (
    <div className="grid min-h-full grid-cols-[minmax(0,1fr)] content-start gap-3 lg:h-full lg:min-h-0 lg:grid-cols-[minmax(0,1fr)_minmax(22rem,var(--column))] lg:grid-rows-[minmax(0,1fr)] lg:content-stretch">
      <div className="flex min-h-0 flex-col gap-3">
        <ScriptBanner />
        <StatePanel isStopped={isStopped} isClosed={isClosed} />
        <ReadBackCard />
        <Transcript />
        <SayForm />
      </div>
      <div className="flex min-h-0 flex-col gap-3 lg:overflow-y-auto">
        <CallList />
        <SetupPanel />
      </div>
    </div>
  );
}
