/** The requests to the doctor. */
import { postJson } from "@/api/http";
import type { PlayResult } from "./diagnosis";

/** A fix may restart the robot's stack, which takes minutes. */
const FIX_TIMEOUT_MS = 310_000;

/** Play the fix of a finding, or only preview it. Throws ApiError with the reason. */
export function playFix(finding: string, confirmed: boolean): Promise<PlayResult> {
  return postJson<PlayResult>("/_api/doctor/fix", { finding, confirmed }, FIX_TIMEOUT_MS);
}
