import type { ReactNode } from "react";
import { useAge } from "@/hooks/use_now";
import { useText } from "@/i18n/text";
import { DoctorButton } from "@/widgets/doctor_button";
import { formatDuration } from "@/ui/numbers";

export interface Freshness {
  /** Seconds since the last sample; null before the first. */
  age: number | null;
  isStale: boolean;
  /** What a panel shows of it. */
  panel: { tone?: "stale" | "empty"; notice?: ReactNode };
}

/** How fresh the last sample of a topic is, and what its panel says while it is missing or out of date. */
export function useFreshness(topic: string, receivedMs: number | null | undefined, staleAfterS = 3): Freshness {
  const text = useText();
  const age = useAge(receivedMs);
  if (age === null) return { age, isStale: false, panel: { tone: "empty", notice: text("no_sample_yet", { topic }) } };
  if (age <= staleAfterS) return { age, isStale: false, panel: {} };
  const notice = (
    <>
      <span className="grow">{text("stale_since", { topic, age: formatDuration(age) })}</span>
      <span className="-my-1">
        <DoctorButton size="small" />
      </span>
    </>
  );
  return { age, isStale: true, panel: { tone: "stale", notice } };
}
