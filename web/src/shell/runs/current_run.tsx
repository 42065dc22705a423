import { type ProcessState, useConsole } from "@/api/console_store";
import { type Text, TEXT_KEYS, type TextKey, useText } from "@/i18n/text";
import { cn } from "@/ui/cn";
import { UNKNOWN, clock, fixed } from "@/ui/numbers";

/** The run of this console: its processes, and what is wrong with them. */
export function CurrentRun() {
  const text = useText();
  const run = useConsole((state) => state.run);
  const processes = run.stages ?? [];
  return (
    <section aria-label={text("runs_current")} className="flex flex-col gap-2">
      <h3 className="flex items-baseline gap-3 text-sm font-semibold text-text-2">
        <span className="grow">{text("runs_current")}</span>
        {run.id !== undefined && <span className="text-xs font-normal text-text-3 numeric">{run.id}</span>}
        {run.age_s !== undefined && <span className="text-xs font-normal text-text-3">{text("runs_up_for", { age: clock(run.age_s) })}</span>}
      </h3>
      {(run.alarms ?? []).map((alarm) => (
        <p key={alarm} role="status" className="rounded-md bg-attention-wash px-4 py-2 text-attention">
          {alarm}
        </p>
      ))}
      {processes.length === 0 ? (
        <p className="text-text-3">{text("runs_none")}</p>
      ) : (
        <div className="overflow-x-auto">
          <table className="w-full">
            <thead className="text-left text-xs text-text-3">
              <tr>
                <th className="py-1 font-normal">{text("runs_process")}</th>
                <th className="py-1 font-normal">{text("runs_phase")}</th>
                <th className="py-1 text-right font-normal">{text("runs_cpu")}</th>
                <th className="py-1 text-right font-normal">{text("runs_memory")}</th>
                <th className="py-1 text-right font-normal max-md:hidden">{text("runs_restarts")}</th>
              </tr>
            </thead>
            <tbody>
              {processes.map((process) => (
                <ProcessRow key={process.name} process={process} text={text} />
              ))}
            </tbody>
          </table>
        </div>
      )}
    </section>
  );
}

function ProcessRow({ process, text }: { process: ProcessState; text: Text }) {
  const { name, phase, trouble, why, waiting_for = [], cpu_percent, memory_mb, restarts = 0 } = process;
  const detail = trouble || why || (waiting_for.length > 0 ? text("runs_waits", { what: waiting_for.join(", ") }) : "");
  const isWell = phase === "up" && trouble === "";
  return (
    <tr className="border-t border-line align-baseline">
      <td className="py-1.5 font-semibold">{name}</td>
      <td className={cn("py-1.5", isWell ? "text-text-2" : phase === "failed" ? "text-stop-text" : "text-attention")}>
        {phaseLabel(phase, text)}
        {detail !== "" && <span className="block text-xs">{detail}</span>}
      </td>
      <td className="py-1.5 text-right whitespace-nowrap">
        <span className="numeric">{fixed(cpu_percent, 0)}</span> <span className="text-xs text-text-3">%</span>
      </td>
      <td className="py-1.5 text-right whitespace-nowrap">
        <span className="numeric">{fixed(memory_mb, 0)}</span> <span className="text-xs text-text-3">MB</span>
      </td>
      <td className={cn("py-1.5 text-right numeric max-md:hidden", restarts > 0 ? "text-attention" : "text-text-3")}>{restarts > 0 ? restarts : UNKNOWN}</td>
    </tr>
  );
}

function phaseLabel(phase: string, text: Text): string {
  const key = `runs_phase_${phase}`;
  return (TEXT_KEYS as readonly string[]).includes(key) ? text(key as TextKey) : phase;
}
