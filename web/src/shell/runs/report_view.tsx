import { ArrowLeft, ExternalLink } from "lucide-react";
import { useEffect, useState } from "react";
import { request } from "@/api/http";
import { IS_MOCK } from "@/environment";
import { errorText } from "@/i18n/error_text";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { reportPath } from "./run_lists";

/** The report of a run, in a sandboxed frame that has no access to this page. */
export function ReportView({ run, onBack }: { run: string; onBack: () => void }) {
  const text = useText();
  const path = reportPath(run);
  const problem = useProblem(path);
  const page = useMockPage(path);
  return (
    <div className="flex h-[70dvh] flex-col gap-3">
      <div className="flex flex-wrap items-center gap-2">
        <Button kind="quiet" onClick={onBack}>
          <ArrowLeft />
          {text("runs_back")}
        </Button>
        <a href={path} target="_blank" rel="noreferrer" className="ml-auto inline-flex min-h-11 items-center gap-2 text-text-2 underline hover:text-text">
          <ExternalLink aria-hidden="true" className="size-4" />
          {text("runs_open_report")}
        </a>
      </div>
      {problem !== "" ? (
        <p role="alert" className="text-attention">
          {text("runs_failed", { reason: problem })}
        </p>
      ) : IS_MOCK && page === null ? null : (
        <iframe
          title={text("runs_report_title", { run })}
          sandbox="allow-scripts"
          // The space bar would not stop the robot from within: the link above opens the report for the keyboard.
          tabIndex={-1}
          {...(page === null ? { src: path } : { srcDoc: page })}
          className="min-h-0 grow rounded-md border border-line bg-white"
        />
      )}
    </div>
  );
}

/** Why there is no report, in the server's words: an <iframe> would show them as a page. */
function useProblem(path: string): string {
  const [problem, setProblem] = useState("");
  useEffect(() => {
    const abort = new AbortController();
    request(path, { signal: abort.signal })
      .then(async (response) => setProblem(response.ok ? "" : (await response.text()).trim().slice(0, 300)))
      .catch((error: unknown) => !abort.signal.aborted && setProblem(errorText(error)))
      .finally(() => abort.abort());
    return () => abort.abort();
  }, [path]);
  return problem;
}

/** In the mock mode no server has the page, so it is passed as text. */
function useMockPage(path: string): string | null {
  const [page, setPage] = useState<string | null>(null);
  useEffect(() => {
    if (!IS_MOCK) return;
    request(path)
      .then((response) => response.text())
      .then(setPage)
      .catch(() => {});
  }, [path]);
  return page;
}
