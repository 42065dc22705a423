import { clock } from "@/ui/numbers";

/** A time of the robot's clock as text; in the simulator, that is the time since its start. */
export function writeMoment(atS: number, language: string): string {
  return atS > 1e9 ? new Date(atS * 1000).toLocaleTimeString(language) : clock(atS);
}
