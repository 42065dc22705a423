import type { ReactNode } from "react";
import { ClockContext, LIVE_CLOCK } from "@/hooks/use_now";
import { TopicsContext } from "@/hooks/use_topic";
import { topics } from "@/robot/link";
import { recordedTopics } from "./rewind";
import { useIsRewound } from "@/state/rewind";
import { REWOUND_CLOCK } from "@/hooks/view_clock";

/** Gives the views in it samples and time of the shown moment. What is outside of it stays live. */
export function ShownTime({ children }: { children: ReactNode }) {
  const isRewound = useIsRewound();
  return (
    <TopicsContext value={isRewound ? recordedTopics : topics}>
      <ClockContext value={isRewound ? REWOUND_CLOCK : LIVE_CLOCK}>{children}</ClockContext>
    </TopicsContext>
  );
}
