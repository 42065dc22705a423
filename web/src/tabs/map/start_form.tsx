import { Play } from "lucide-react";
import { useState } from "react";
import { SERVICES } from "@/generated/graph";
import { useNavigates } from "@/hooks/use_situation";
import { type TextKey, useText } from "@/i18n/text";
import { useMissionLog } from "@/map/mission_log";
import { ALL_TAGS, readTagIds } from "@/map/mission_rules";
import { call } from "@/robot/commands";
import { showDone, showProblem } from "@/state/problems";
import { Button } from "@/ui/button";
import { HoldButton } from "@/ui/hold_button";
import { Segments } from "@/ui/segments";

type MissionType = "ExplorationMission" | "InspectionMission";

const FIELD = "h-10 min-w-0 rounded-md border border-line-strong bg-well px-3 placeholder:text-text-3 max-xl:h-11 pointer-coarse:h-11";

/** The settings of the next mission, and the button that starts it. */
export function StartForm({ refusal }: { refusal: TextKey | null }) {
  const text = useText();
  const [type, setType] = useState<MissionType>("ExplorationMission");
  const [goal, setGoal] = useState("");
  const [tags, setTags] = useState("");
  const [isBusy, setBusy] = useState(false);
  const navigates = useNavigates();
  const isExploration = type === "ExplorationMission";

  async function start(): Promise<void> {
    setBusy(true);
    try {
      const sequence = isExploration ? [] : readTagIds(tags);
      const discovery_goal = isExploration ? Math.min(ALL_TAGS, Math.max(0, Math.round(Number(goal) || 0))) : 0;
      const answer = await call(SERVICES.MISSION_START, { mission_type: type, tag_sequence: sequence, discovery_goal });
      if (!answer.accepted) throw new Error(answer.error_message);
      if (sequence.length > 0) useMissionLog.setState({ requested: { missionId: answer.mission_id, tags: sequence } });
      showDone(text("mission_started", { id: answer.mission_id }));
    } catch (error) {
      showProblem(error);
    } finally {
      setBusy(false);
    }
  }

  return (
    <form
      className="flex flex-wrap items-center justify-end gap-2 max-md:w-full max-md:justify-start"
      onSubmit={(event) => {
        event.preventDefault();
        if (!navigates) void start();
      }}
    >
      <Segments
        label={text("mission_type")}
        value={type}
        options={[
          { value: "ExplorationMission", label: text("mission_exploration") },
          { value: "InspectionMission", label: text("mission_inspection") },
        ]}
        onChange={setType}
      />
      {isExploration ? (
        <>
          <input
            type="number"
            inputMode="numeric"
            min={1}
            max={ALL_TAGS}
            value={goal === String(ALL_TAGS) ? "" : goal}
            placeholder={text(goal === String(ALL_TAGS) ? "mission_goal_all_tags" : "mission_goal")}
            aria-label={text("mission_goal")}
            title={text("mission_goal_hint")}
            onChange={(event) => setGoal(event.target.value)}
            className={`${FIELD} w-32`}
          />
          <Button aria-pressed={goal === String(ALL_TAGS)} onClick={() => setGoal(goal === String(ALL_TAGS) ? "" : String(ALL_TAGS))} className="aria-pressed:border-alive-2 aria-pressed:bg-alive-wash">
            {text("mission_goal_all")}
          </Button>
        </>
      ) : (
        <input
          value={tags}
          placeholder={text("mission_tags_hint")}
          aria-label={text("mission_tags")}
          title={text("mission_tags")}
          onChange={(event) => setTags(event.target.value)}
          className={`${FIELD} w-52 grow`}
        />
      )}
      {navigates ? (
        <HoldButton
          disabled={refusal !== null || isBusy}
          title={text(refusal ?? "map_replaces_goal")}
          onHeld={() => void start()}
          className="h-10 max-xl:h-11 max-md:grow pointer-coarse:h-11"
        >
          {text("mission_start_over_goal")}
        </HoldButton>
      ) : (
        <Button
          kind="primary"
          type="submit"
          disabled={refusal !== null || isBusy}
          title={refusal === null ? undefined : text(refusal)}
          className="max-md:grow"
          data-testid="start-mission"
        >
          <Play />
          {text("mission_start")}
        </Button>
      )}
    </form>
  );
}
