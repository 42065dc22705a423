/** The release of the stop: several requests, each of which a new stop overrules. */
import { TextError } from "@/i18n/text_error";
import type { StopGate } from "./stop_gate";

/**
 * Take control, release what this page and lost pages hold, and open the gate.
 *
 * Rejects with a TextError where the gate was closed again meanwhile, by whatever: then it stays closed, and what was stated
 * before the server's release is stated anew by `restate`. Rejects with the reason where the server refuses.
 */
export async function releaseStop(gate: StopGate, ask: (path: string, body: unknown) => Promise<unknown>, restate: () => void): Promise<void> {
  const { closings } = gate;
  const isOverruled = () => gate.closings !== closings;
  await ask("/_api/lease", { action: "take" });
  if (isOverruled()) throw new TextError("release_overruled");
  // The gate repeats its stop twice a second: it must not be stated again between the release and the server's answer.
  if (gate.isStated) gate.withdraw();
  try {
    await ask("/_api/stop", { engaged: false });
  } finally {
    // Also without an answer: the server may have released it, after a newer stop had reached it by another way.
    if (isOverruled()) restate();
  }
  if (isOverruled()) throw new TextError("release_overruled");
  gate.release();
}
