import { useEffect, useState } from "react";
import { useStore } from "zustand";
import { useText } from "@/i18n/text";
import { ArmProvider, createArm, useArmModel, useOpenArm } from "./arm_model";
import { ArmView } from "./arm_view";
import { CalibrationDialog } from "./calibration_dialog";
import { JointsPanel } from "./joints_panel";
import { PosesPanel } from "./poses_panel";
import { SequencesPanel } from "./sequences_panel";
import { TorquePanel } from "./torque_panel";
import { useArmReports, useLibraryObstacles, useLibraryState, useMeasured, useSliderObstacles } from "./use_arm";
import { useLibrary } from "./use_library";

/** The Arm tab: the arm, its joints and its library. */
export default function ArmTab() {
  // Created anew whenever the tab is opened: the torque is then unknown.
  const [arm] = useState(createArm);
  useEffect(() => {
    useOpenArm.setState({ arm });
    return () => useOpenArm.setState({ arm: null });
  }, [arm]);
  return (
    <ArmProvider value={arm}>
      <ArmBoard />
    </ArmProvider>
  );
}

function ArmBoard() {
  const text = useText();
  const arm = useArmModel();
  const [isCalibrating, setCalibrating] = useState(false);
  const isAwaitingPose = useStore(arm.store, ({ calibration }) => calibration === "AWAITING_POSE");
  const measured = useMeasured();
  const library = useLibraryState();
  const libraryObstacles = useLibraryObstacles();
  const obstacles = useSliderObstacles(library, measured);
  const isBlocked = obstacles.length > 0;
  const isBusy = library !== null && (library.recording || library.playing);
  const reading = useLibrary(isBusy);
  useArmReports(library, isBlocked);

  return (
    <div className="grid min-h-full grid-cols-[minmax(0,1fr)] gap-3 lg:h-full lg:min-h-[40rem] lg:grid-cols-[minmax(0,1fr)_minmax(24rem,var(--arm-column,32rem))] lg:grid-rows-[minmax(0,1fr)]">
      <div className="contents lg:grid lg:min-h-0 lg:grid-rows-[minmax(16rem,1fr)_minmax(14rem,17.5rem)] lg:gap-3">
        <div className="grid max-lg:order-2 max-lg:h-80">
          <ArmView measured={measured} />
        </div>
        <div className="grid gap-3 max-lg:order-4 xl:min-h-0 xl:grid-cols-2 xl:grid-rows-[minmax(0,1fr)]">
          <PosesPanel reading={reading} arePresetsBlocked={isBlocked} isLibraryBlocked={libraryObstacles.length > 0} isBusy={isBusy} />
          <SequencesPanel reading={reading} state={library} isBlocked={libraryObstacles.length > 0} />
        </div>
      </div>
      <div className="contents lg:flex lg:min-h-0 lg:flex-col lg:gap-3 lg:overflow-y-auto">
        <div className="max-lg:order-1">
          <TorquePanel obstacles={obstacles} />
          {isAwaitingPose && !isCalibrating && (
            <button type="button" onClick={() => setCalibrating(true)} className="mt-3 min-h-11 w-full rounded-md border border-attention bg-attention-wash px-4 text-left text-attention">
              {text("arm_calibration_waits")}
            </button>
          )}
        </div>
        <div className="max-lg:order-3 lg:grid lg:grow">
          <JointsPanel measured={measured} obstacles={obstacles} onCalibrate={() => setCalibrating(true)} />
        </div>
      </div>
      {isCalibrating && <CalibrationDialog onClose={() => setCalibrating(false)} />}
    </div>
  );
}
