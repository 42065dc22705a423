import { BookmarkPlus, House } from "lucide-react";
import { useState } from "react";
import { SERVICES } from "@/generated/graph";
import { PRESET_DURATION_S } from "@/generated/robot";
import { useText } from "@/i18n/text";
import { call } from "@/robot/commands";
import { showAnswer } from "@/state/problems";
import { Button } from "@/ui/button";
import { Panel } from "@/ui/panel";
import { Switch } from "@/ui/switch";
import { PRESETS, useArmModel } from "./arm_model";
import { EntryMenu } from "./entry_menu";
import { NameDialog } from "./name_dialog";
import type { LibraryReading } from "./use_library";

interface PosesPanelProps {
  reading: LibraryReading;
  /** The presets need the torque, too. */
  arePresetsBlocked: boolean;
  isLibraryBlocked: boolean;
  isBusy: boolean;
}

/** Built-in presets, and the poses that operators saved. */
export function PosesPanel({ reading, arePresetsBlocked, isLibraryBlocked, isBusy }: PosesPanelProps) {
  const text = useText();
  const arm = useArmModel();
  const [isSaving, setSaving] = useState(false);
  const poses = reading.library?.poses ?? [];
  const names = poses.map(({ name }) => name);

  async function goTo(name: string): Promise<void> {
    await showAnswer(call(SERVICES.ARM_LIBRARY_GOTO_POSE, { name }));
  }

  return (
    <Panel
      title={text("arm_poses")}
      aside={
        <Button size="small" className="text-text" disabled={isLibraryBlocked} onClick={() => setSaving(true)}>
          <BookmarkPlus />
          {text("arm_save_pose")}
        </Button>
      }
      className="min-h-56"
      bodyClassName="flex min-h-0 flex-col gap-2"
      notice={reading.problem !== "" ? text("arm_library_problem", { reason: reading.problem }) : null}
    >
      <div className="flex flex-wrap gap-2" role="group" aria-label={text("arm_presets", { seconds: PRESET_DURATION_S })}>
        {PRESETS.map((name) => (
          <Button key={name} size="small" disabled={arePresetsBlocked} onClick={() => void arm.goToPreset(name)}>
            {name === "home" && <House />}
            {text(`arm_preset_${name}`)}
          </Button>
        ))}
      </div>
      {poses.length === 0 ? (
        <p className="py-2 text-sm text-text-3">{reading.library === null ? text("arm_library_unknown") : text("arm_no_poses")}</p>
      ) : (
        <ul className="-mx-2 min-h-0 grow overflow-y-auto">
          {poses.map((pose) => (
            <li key={pose.name} className="flex items-center gap-2 rounded-md px-2 hover:bg-raised">
              <p className="min-w-0 grow truncate">
                <span className="font-semibold">{pose.name}</span>
                {pose.hasGripper && <span className="ml-2 text-xs text-text-3">{text("arm_with_gripper")}</span>}
                {pose.note !== "" && <span className="ml-2 text-xs text-text-3">{pose.note}</span>}
              </p>
              <Button size="small" className="min-w-11" disabled={isLibraryBlocked || isBusy} onClick={() => void goTo(pose.name)}>
                {text("arm_go_to")}
              </Button>
              <EntryMenu kind="pose" name={pose.name} taken={names} disabled={isLibraryBlocked} onChanged={reading.reload} />
            </li>
          ))}
        </ul>
      )}
      {isSaving && <SavePoseDialog taken={names} onClose={() => setSaving(false)} onSaved={reading.reload} />}
    </Panel>
  );
}

function SavePoseDialog({ taken, onClose, onSaved }: { taken: readonly string[]; onClose: () => void; onSaved: () => void }) {
  const text = useText();
  const [withGripper, setWithGripper] = useState(true);

  async function save(name: string, overwrite: boolean): Promise<boolean> {
    const request = { name, from_current: true, has_gripper: withGripper, overwrite };
    const isSaved = await showAnswer(call(SERVICES.ARM_LIBRARY_SAVE_POSE, request));
    if (isSaved) onSaved();
    return isSaved;
  }

  return (
    <NameDialog title={text("arm_save_pose")} description={text("arm_save_pose_explained")} submitLabel={text("arm_save")} taken={taken} mayOverwrite onClose={onClose} onSubmit={save}>
      <Switch label={text("arm_include_gripper")} checked={withGripper} onChange={setWithGripper} />
    </NameDialog>
  );
}
