import { Ruler, TriangleAlert } from "lucide-react";
import { useCallback, useEffect, useState } from "react";
import { useStore } from "zustand";
import { SERVICES } from "@/generated/graph";
import type { lupin_msgs_CalibrateArm_Response } from "@/generated/messages";
import { errorText } from "@/i18n/error_text";
import { useText } from "@/i18n/text";
import { call } from "@/robot/commands";
import { Button } from "@/ui/button";
import { Dialog } from "@/ui/dialog";
import { HoldButton } from "@/ui/hold_button";
import { signed } from "@/ui/numbers";
import { useArmModel } from "./arm_model";
import { type CalibrationAction, calibrationState, offsetRows } from "./calibration";

/** Starting a calibration waits 2 s until the servos are at rest, and makes three calls per servo. */
const TIMEOUT_MS = 60_000;

/** Calibrates the zero offsets of the servos: the arm becomes limp, is posed by hand, and its pose becomes the zero. */
export function CalibrationDialog({ onClose }: { onClose: () => void }) {
  const text = useText();
  const arm = useArmModel();
  const state = useStore(arm.store, (each) => each.calibration);
  const [busy, setBusy] = useState<CalibrationAction | null>("status");
  const [answer, setAnswer] = useState<lupin_msgs_CalibrateArm_Response | null>(null);
  const [problem, setProblem] = useState("");
  const { setCalibration, applyTorqueEvent } = arm;

  const request = useCallback(
    (action: CalibrationAction) => {
      // Only these two can move the arm: asking for the state is always allowed, and so is giving up.
      const moves = action === "start" || action === "commit";
      call({ ...SERVICES.ARM_CALIBRATE, moves }, { action }, TIMEOUT_MS)
        .then((received) => {
          setCalibration(calibrationState(received.state));
          if (received.success) setAnswer(received);
          else setProblem(received.message);
          // A calibration switches the torque itself, so this tab no longer knows it.
          if (action !== "status") applyTorqueEvent({ kind: "failed" });
        })
        .catch((error: unknown) => setProblem(errorText(error)))
        .finally(() => setBusy(null));
    },
    [setCalibration, applyTorqueEvent],
  );

  function act(action: CalibrationAction): void {
    setBusy(action);
    setProblem("");
    request(action);
  }

  useEffect(() => request("status"), [request]);

  const isAwaiting = state === "AWAITING_POSE";
  const rows = answer === null ? [] : offsetRows(answer);
  return (
    <Dialog open onOpenChange={(open) => !open && onClose()} title={text("arm_calibration")} description={text("arm_calibration_explained")} className="w-[min(640px,calc(100vw-1.5rem))]">
      <div className="flex flex-col gap-4" aria-busy={busy !== null}>
        <ol className="grid grid-cols-2 gap-3">
          {(["IDLE", "AWAITING_POSE"] as const).map((step, index) => (
            <li
              key={step}
              aria-current={state === step ? "step" : undefined}
              className={`rounded-md border px-3 py-2 ${state === step ? "border-alive-2 bg-alive-wash" : "border-line text-text-3"}`}
            >
              <span className="text-xs numeric">{index + 1} </span>
              <span className="font-semibold">{text(`arm_calibration_${step}`)}</span>
              <span className="block text-xs">{text(`arm_calibration_${step}_hint`)}</span>
            </li>
          ))}
        </ol>
        {state === null && problem !== "" && <p className="text-text-2">{text("arm_calibration_absent")}</p>}
        {problem !== "" && (
          <p role="alert" className="flex items-start gap-3 text-stop-text">
            <TriangleAlert aria-hidden="true" className="mt-0.5 size-4 shrink-0" />
            <span className="min-w-0 break-words">{problem}</span>
          </p>
        )}
        {problem === "" && answer !== null && rows.length === 0 && <p role="status">{answer.message}</p>}
        {rows.length > 0 && <OffsetTable rows={rows} />}
        {state === "IDLE" && (
          <p className="flex items-start gap-3 rounded-md border border-attention bg-attention-wash p-3 text-attention">
            <TriangleAlert aria-hidden="true" className="mt-0.5 size-5 shrink-0" />
            {text("arm_calibration_warning")}
          </p>
        )}
        <div className="flex flex-wrap justify-end gap-3">
          {isAwaiting ? (
            <>
              <Button className="h-11" disabled={busy !== null} onClick={() => act("cancel")}>
                {text("arm_calibration_cancel")}
              </Button>
              <HoldButton disabled={busy !== null} onHeld={() => act("commit")}>
                {busy === "commit" ? text("arm_calibration_measuring") : text("arm_calibration_commit")}
              </HoldButton>
            </>
          ) : (
            <HoldButton disabled={busy !== null || state === null} onHeld={() => act("start")}>
              <Ruler aria-hidden="true" className="size-4" />
              {busy === "start" ? text("arm_calibration_starting") : text("arm_calibration_start")}
            </HoldButton>
          )}
        </div>
      </div>
    </Dialog>
  );
}

function OffsetTable({ rows }: { rows: ReturnType<typeof offsetRows> }) {
  const text = useText();
  return (
    <div className="overflow-x-auto">
      <table className="w-full text-left text-sm">
        <thead className="text-xs text-text-3">
          <tr>
            <th className="py-1 pr-3 font-normal">{text("arm_calibration_joint")}</th>
            <th className="py-1 pr-3 text-right font-normal">{text("arm_calibration_difference")}</th>
            <th className="py-1 pr-3 text-right font-normal">{text("arm_calibration_offset")}</th>
            <th className="py-1 font-normal">{text("arm_calibration_remark")}</th>
          </tr>
        </thead>
        <tbody>
          {rows.map((row) => (
            <tr key={row.joint} className="border-t border-line">
              <th scope="row" className="py-2 pr-3 font-semibold">
                {row.joint}
              </th>
              <td className="py-2 pr-3 text-right numeric">{signed(row.difference, 0)}</td>
              <td className="py-2 pr-3 text-right numeric">{row.offset === 0 ? text("arm_calibration_kept") : signed(row.offset, 0)}</td>
              <td className="py-2 text-text-2">{row.remark}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}
