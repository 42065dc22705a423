import { useEffect, useState } from "react";
import { SERVICES } from "@/generated/graph";
import { call } from "@/robot/commands";

/** Whether anything on the robot listens to a topic; null while that is not known. */
export function useIsHeard(topic: string): boolean | null {
  const [isHeard, setHeard] = useState<boolean | null>(null);
  useEffect(() => {
    let isWanted = true;
    call(SERVICES.SUBSCRIBERS, { topic }).then(
      ({ subscribers }) => isWanted && setHeard(subscribers.length > 0),
      () => isWanted && setHeard(null),
    );
    return () => {
      isWanted = false;
    };
  }, [topic]);
  return isHeard;
}
