import { ChevronDown, OctagonAlert, TriangleAlert } from "lucide-react";
import type { ReactNode } from "react";
import type { Finding } from "@/api/console_store";
import { useText } from "@/i18n/text";
import { cn } from "@/ui/cn";
import { isProblem } from "./diagnosis";
import { FixPanel } from "./fix_panel";

/** A root cause: what is wrong, how that shows, the lines that prove it, what it explains, and its fix. */
export function FindingItem({ finding }: { finding: Finding }) {
  const text = useText();
  const consequences = finding.consequences ?? [];
  const problem = isProblem(finding);
  const Icon = problem ? OctagonAlert : TriangleAlert;
  return (
    <li className={cn("flex gap-3 rounded-md border px-4 py-3", problem ? "border-stop/60 bg-stop-wash" : "border-line bg-attention-wash")}>
      <Icon aria-hidden="true" className={cn("mt-0.5 size-5 shrink-0", problem ? "text-stop-text" : "text-attention")} />
      <div className="flex min-w-0 grow flex-col gap-2">
        <div>
          <p className="text-base leading-snug font-semibold">
            <span className="sr-only">{text(problem ? "doctor_problem" : "doctor_warning")}: </span>
            {finding.cause}
          </p>
          <p className="text-text-2">{text("doctor_symptom", { symptom: finding.symptom })}</p>
          <p className="text-xs text-text-3">
            {finding.where} · <span className="numeric">{finding.id}</span>
          </p>
        </div>
        <Evidence lines={finding.evidence} />
        {consequences.length > 0 && (
          <details className="group">
            <Summary>{text("doctor_consequences", { count: consequences.length })}</Summary>
            <ul className="flex flex-col gap-2 border-l-2 border-line pt-1 pl-3">
              {consequences.map((each) => (
                <li key={`${each.id} ${each.where}`}>
                  <p className="font-semibold">{each.cause}</p>
                  <p className="text-xs text-text-2">{each.symptom}</p>
                  <Evidence lines={each.evidence} />
                </li>
              ))}
            </ul>
          </details>
        )}
        <FixPanel finding={finding} />
      </div>
    </li>
  );
}

function Evidence({ lines }: { lines: readonly string[] }) {
  const text = useText();
  if (lines.length === 0) return null;
  return (
    <details className="group">
      <Summary>
        {text("doctor_evidence")} <span className="text-text-3 numeric">{lines.length}</span>
      </Summary>
      <pre className="overflow-x-auto rounded-sm bg-well px-3 py-2 text-xs whitespace-pre-wrap text-text-2 numeric">{lines.join("\n")}</pre>
    </details>
  );
}

export function Summary({ children }: { children: ReactNode }) {
  return (
    <summary className="flex min-h-9 cursor-pointer list-none items-center gap-1.5 text-sm text-text-2 hover:text-text max-xl:min-h-11">
      <ChevronDown aria-hidden="true" className="size-4 -rotate-90 transition-transform group-open:rotate-0" />
      {children}
    </summary>
  );
}
