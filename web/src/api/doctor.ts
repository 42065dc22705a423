import { showProblem } from "@/state/problems";
import { type DoctorState, useConsole } from "./console_store";
import { postJson } from "./http";

/** Examine this computer, the robot and the graph. The events report its end. */
export async function examine(): Promise<void> {
  try {
    useConsole.setState({ doctor: await postJson<DoctorState>("/_api/doctor/examination", {}) });
  } catch (error) {
    showProblem(error);
  }
}
