import { Hand } from "lucide-react";
import { postJson } from "@/api/http";
import { useHeldAtZero, useMissionDrives } from "@/hooks/use_situation";
import { useText } from "@/i18n/text";
import { useIsRewound } from "@/state/rewind";
import { showProblem } from "@/state/problems";
import { Button } from "@/ui/button";

/** Says that this page keeps a mission from moving the robot: nothing else on the page would, as the mission believes it drives. */
export function WheelsBanner() {
  const text = useText();
  const isHeld = useHeldAtZero();
  const missionDrives = useMissionDrives();
  const isRewound = useIsRewound();
  if (!isHeld || !missionDrives || isRewound) return null;
  return (
    <div role="alert" data-testid="wheels-held" className="flex min-h-12 shrink-0 flex-wrap items-center gap-x-4 gap-y-2 border-b border-attention bg-attention-wash px-4 py-2 text-attention">
      <Hand aria-hidden="true" className="size-5 shrink-0" />
      <p className="min-w-0 grow basis-60 font-semibold">{text("wheels_held")}</p>
      <Button onClick={() => void postJson("/_api/lease", { action: "give_up" }).catch(showProblem)}>{text("give_up_control")}</Button>
    </div>
  );
}
