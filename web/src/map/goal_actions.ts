/** What the operator's drawn poses do on the robot. */
import { postJson } from "@/api/http";
import { ACTIONS, TOPICS } from "@/generated/graph";
import type { nav2_msgs_ComputePathToPose_Result } from "@/generated/messages";
import { TextError } from "@/i18n/text_error";
import { checkCommand, publish } from "@/robot/commands";
import { link, topics } from "@/robot/link";
import { cancelGoals } from "@/robot/stop";
import type { Pose2 } from "@/ros/tf";
import { setting } from "@/state/settings";
import { goalMessage, idsOf, initialPoseMessage, pathProblem } from "./goal";
import { type Preview, dropDraft, useMapUi } from "./map_ui";
import { readPath } from "./route";

/** Send the robot to a pose. Navigation says what becomes of it: its status is subscribed to while the map is shown. Throws where the server refuses control. */
export async function sendGoal(pose: Pose2): Promise<void> {
  const row = { ...TOPICS.GOAL_POSE, name: setting("goalPoseTopic") };
  checkCommand(row);
  await takeControl();
  const known = idsOf(topics.last(TOPICS.NAVIGATE_STATUS)?.message.status_list ?? []);
  if (!publish(row, goalMessage(pose, setting("mapFrame")))) throw new TextError("error_not_connected");
  useMapUi.setState({ sent: { pose, atMs: performance.now(), known }, draft: null, preview: null, tool: "move" });
}

/** Tell the robot where it is. Throws where the server refuses control. */
export async function sendInitialPose(pose: Pose2): Promise<void> {
  await takeControl();
  if (!publish(TOPICS.INITIAL_POSE, initialPoseMessage(pose, setting("mapFrame")))) throw new TextError("error_not_connected");
  useMapUi.setState({ draft: null, preview: null, tool: "move" });
}

/** Tell SLAM where the robot is on the present map. Throws ApiError with the server's reason. */
export async function relocate({ x, y, yaw }: Pose2): Promise<void> {
  await postJson("/_api/maps/relocate", { pose: { x, y, yaw } });
  dropDraft();
}

/** A publication is refused without an answer; this says why before it is sent. */
async function takeControl(): Promise<void> {
  await postJson("/_api/lease", { action: "take" });
}

export function cancelNavigation(): void {
  cancelGoals();
  useMapUi.setState({ sent: null });
}

/** Ask the planner for the way to a pose; the returned function gives up. */
export function askForPath(pose: Pose2, answered: (preview: Preview) => void): () => void {
  const row = ACTIONS.COMPUTE_PATH_TO_POSE;
  const goal = { goal: goalMessage(pose, setting("mapFrame")), planner_id: "", use_start: false };
  const handle = link.sendGoal<nav2_msgs_ComputePathToPose_Result>(row.name, row.type, goal, () => {});
  let isWanted = true;
  let isAnswered = false;
  handle.result
    .then(({ result }) => {
      isAnswered = true;
      const points = readPath(result?.path);
      const problem: Preview["problem"] = pathProblem(result?.error_code ?? 0) ?? (points.length === 0 ? "map_no_path" : null);
      if (isWanted) answered({ points, problem, isPending: false });
    })
    .catch(() => {
      isAnswered = true;
      if (isWanted) answered({ points: [], problem: "map_no_planner", isPending: false });
    });
  return () => {
    isWanted = false;
    if (!isAnswered) handle.cancel();
  };
}
