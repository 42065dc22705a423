/** The requests to the doctor. */
import { postJson } from "@/api/http";
import { type DoctorState, useConsole } from "@/api/console_store";
import { showProblem } from "@/state/problems";
import type { PlayResult } from "./diagnosis";

/** A fix may restart the robot's stack, which takes minutes. */
const FIX_TIMEOUT_MS = 310_000;

/** Examine this computer, the robot and the graph. The events report its end. */
export async function examine(): Promise<void> {
  try {
    useConsole.setState({ doctor: await postJson<DoctorState>("/_api/doctor/examination", {}) });
  } catch (error) {
    showProblem(error);
  }
}

/** Play the fix of a finding, or only preview it. Throws ApiError with the reason. */
export function playFix(finding: string, confirmed: boolean): Promise<PlayResult> {
  return postJson<PlayResult>("/_api/doctor/fix", { finding, confirmed }, FIX_TIMEOUT_MS);
}
