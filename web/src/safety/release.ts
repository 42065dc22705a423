/** The release of the stop: several requests, each of which a new stop overrules. */
import type { StopHold } from "@/api/console_store";
import { TextError } from "@/i18n/text_error";
import type { StopGate } from "./stop_gate";

/** What a release needs of the page. */
export interface ReleaseParts {
  gate: StopGate;
  postJson: (path: string, body: unknown) => Promise<unknown>;
  /** State a stop anew that came while the server was releasing. */
  restate: () => void;
  /** The stops that the operator sees: no other is released. */
  seen: readonly StopHold[];
}

/**
 * Take control, release the stops that the operator has seen, this page's own included, and open the gate.
 *
 * Rejects with a TextError where the gate was closed again meanwhile, by whatever, or where a console still holds the robot: then
 * the gate stays closed, and what was stated before the server's release is stated anew. Rejects with the reason where the server
 * refuses.
 */
export async function releaseStop({ gate, postJson, restate, seen }: ReleaseParts): Promise<void> {
  const { closings } = gate;
  const isOverruled = () => gate.closings !== closings;
  await postJson("/_api/lease", { action: "take" });
  if (isOverruled()) throw new TextError("release_overruled");
  const presses = [gate.press, ...seen.map(({ press }) => press)].filter((press) => press !== null);
  // The gate repeats its stop twice a second: it must not be stated again between the release and the server's answer.
  if (gate.isStated) gate.withdraw();
  let left: readonly StopHold[];
  try {
    left = ((await postJson("/_api/stop", { engaged: false, presses })) as { stop: StopHold[] }).stop;
  } finally {
    // Also without an answer: the server may have released it, after a newer stop had reached it by another way.
    if (isOverruled()) restate();
  }
  if (isOverruled()) throw new TextError("release_overruled");
  const others = left.flatMap(({ name }) => name ?? []);
  if (others.length > 0) throw new TextError("still_holds", { names: others.join(", ") });
  gate.release();
}
