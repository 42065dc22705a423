import { CircleDot, Hand, TriangleAlert } from "lucide-react";
import { useState } from "react";
import { SERVICES } from "@/generated/graph";
import { useText } from "@/i18n/text";
import { call } from "@/robot/commands";
import { showAnswer } from "@/state/problems";
import { Button } from "@/ui/button";
import { Dialog } from "@/ui/dialog";
import { HoldButton } from "@/ui/hold_button";
import { formatDuration } from "@/ui/numbers";
import { Segments } from "@/ui/segments";
import { Switch } from "@/ui/switch";
import type { LibraryState, RecordMode } from "./library";
import { NameDialog } from "./name_dialog";

/** A recording may have to switch the arm's torque, which calls two services. */
const RECORD_TIMEOUT_MS = 30_000;

interface RecordRequest {
  action: "start" | "save" | "cancel";
  name?: string;
  mode?: RecordMode;
  include_gripper?: boolean;
  overwrite?: boolean;
}

function record(request: RecordRequest): Promise<boolean> {
  return showAnswer(call(SERVICES.ARM_LIBRARY_RECORD, request, RECORD_TIMEOUT_MS));
}

/** Asks how to record. A kinesthetic recording makes the arm limp: the dialog warns, and its start button must be held. */
export function RecordDialog({ onClose }: { onClose: () => void }) {
  const text = useText();
  const [mode, setMode] = useState<RecordMode>("teleop");
  const [withGripper, setWithGripper] = useState(true);
  const isLimp = mode === "kinesthetic";

  async function start(): Promise<void> {
    if (await record({ action: "start", mode, include_gripper: withGripper })) onClose();
  }

  return (
    <Dialog open onOpenChange={(open) => !open && onClose()} title={text("arm_record_title")} description={text("arm_record_explained")}>
      <div className="flex flex-col gap-4">
        <Segments
          label={text("arm_mode")}
          value={mode}
          onChange={setMode}
          options={[
            { value: "teleop", label: text("arm_mode_teleop") },
            { value: "kinesthetic", label: text("arm_mode_kinesthetic") },
          ]}
          className="self-start"
        />
        <p className="text-text-2">{text(isLimp ? "arm_kinesthetic_explained" : "arm_teleop_explained")}</p>
        {isLimp && (
          <p role="alert" className="flex items-start gap-3 rounded-md border border-attention bg-attention-wash p-3 font-semibold text-attention">
            <TriangleAlert aria-hidden="true" className="mt-0.5 size-5 shrink-0" />
            {text("arm_sags")}
          </p>
        )}
        <Switch label={text("arm_include_gripper")} checked={withGripper} onChange={setWithGripper} />
        <div className="flex justify-end gap-3">
          <Button className="h-11" onClick={onClose}>
            {text("cancel")}
          </Button>
          {isLimp ? (
            <HoldButton onHeld={() => void start()}>
              <Hand aria-hidden="true" className="size-4" />
              {text("arm_hold_to_release")}
            </HoldButton>
          ) : (
            <Button kind="primary" className="h-11" onClick={() => void start()}>
              <CircleDot />
              {text("arm_record")}
            </Button>
          )}
        </div>
      </div>
    </Dialog>
  );
}

/** A running recording, to be saved under a name or discarded. */
export function RecordingBar({ state, taken, onSaved }: { state: LibraryState; taken: readonly string[]; onSaved: () => void }) {
  const text = useText();
  const [isSaving, setSaving] = useState(false);
  const isLimp = state.mode === "kinesthetic";
  return (
    <div className="rounded-md border border-attention/60 bg-attention-wash p-3">
      <p role="status" className="flex items-center gap-2">
        <CircleDot aria-hidden="true" className="size-4 shrink-0 text-attention" />
        <span className="min-w-0 grow truncate font-semibold">{text(isLimp ? "arm_recording_kinesthetic" : "arm_recording_teleop")}</span>
        <span aria-hidden="true" className="text-sm whitespace-nowrap text-text-2">
          <span className="numeric">{formatDuration(state.elapsedS)}</span> · {text("arm_points", { count: state.waypoints })}
        </span>
      </p>
      {isLimp && <p className="mt-1 text-xs text-attention">{text("arm_limp_now")}</p>}
      <div className="mt-2 flex flex-wrap gap-2">
        <Button kind="primary" className="h-11" onClick={() => setSaving(true)}>
          {text("arm_save_recording")}
        </Button>
        <Button className="h-11" onClick={() => void record({ action: "cancel" })}>
          {text("arm_discard")}
        </Button>
      </div>
      {isSaving && (
        <NameDialog
          title={text("arm_save_recording")}
          submitLabel={text("arm_save")}
          {...(isLimp ? { description: text("arm_stiff_after_save") } : {})}
          initial={state.name}
          taken={taken}
          mayOverwrite
          onClose={() => setSaving(false)}
          onSubmit={async (name, overwrite) => {
            const worked = await record({ action: "save", name, overwrite });
            if (worked) onSaved();
            return worked;
          }}
        />
      )}
    </div>
  );
}
