/** Polls a resource of the API as long as something shows it. */
import { useCallback, useEffect, useState } from "react";
import { errorText } from "@/i18n/error_text";

export interface Polled<Value> {
  value: Value | null;
  /** Why the last request failed; empty if it did not. */
  problem: string;
  /** performance.now() of the last answer; null before it. */
  receivedMs: number | null;
  reload: () => void;
}

/** `read` must be the same function while its resource is the same. Without a period, the resource is read once. */
export function usePolled<Value>(read: (() => Promise<Value>) | null, periodMs: number | null): Polled<Value> {
  const [state, setState] = useState<Omit<Polled<Value>, "reload"> & { of: unknown }>({ value: null, problem: "", receivedMs: null, of: null });

  const reload = useCallback(() => {
    if (read === null) return;
    read()
      .then((value) => setState({ value, problem: "", receivedMs: performance.now(), of: read }))
      .catch((error: unknown) => {
        const problem = errorText(error);
        setState((before) => ({ ...(before.of === read ? before : { value: null, receivedMs: null }), problem, of: read }));
      });
  }, [read]);

  useEffect(() => {
    reload();
    if (periodMs === null) return;
    const timer = setInterval(() => {
      if (!document.hidden) reload();
    }, periodMs);
    return () => clearInterval(timer);
  }, [reload, periodMs]);

  // Data of the previous resource is not shown as this one's.
  const isOwn = state.of === read;
  return { value: isOwn ? state.value : null, problem: isOwn ? state.problem : "", receivedMs: isOwn ? state.receivedMs : null, reload };
}
