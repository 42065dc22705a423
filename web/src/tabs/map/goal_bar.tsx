import { Check, Navigation, X } from "lucide-react";
import { type ReactNode, useEffect, useLayoutEffect } from "react";
import { TOPICS } from "@/generated/graph";
import type { action_msgs_GoalStatusArray } from "@/generated/messages";
import { useNow } from "@/hooks/use_now";
import { useTopicValue } from "@/hooks/use_topic_value";
import { useMotionObstacles, useNavigates, useRelocationObstacles } from "@/hooks/use_situation";
import { wordsIn } from "@/i18n/robot_words";
import { type TextKey, useLanguage, useText } from "@/i18n/text";
import { changeApproach } from "@/map/approaches";
import { besideGoalM, goalProgress, statusSince } from "@/map/goal";
import { cancelNavigation, relocate, sendGoal, sendInitialPose } from "@/map/goal_actions";
import { liveMap } from "@/map/live_map";
import { useIsHeard } from "@/map/use_is_heard";
import { isRunning, useMissionState } from "@/map/use_mission";
import { type Draft, type Preview, draftSender, dropDraft, useMapUi } from "@/map/map_ui";
import { lengthOf, shownPlan } from "@/map/route";
import { writeLength } from "@/map/sensor_text";
import { useLink } from "@/robot/link";
import type { Sample } from "@/ros/topics";
import { showDone, showProblem } from "@/state/problems";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { fixed, formatDuration, toDegrees } from "@/ui/numbers";

/** What the drawn pose would do, with the button that does it; afterwards, the outcome. */
export function GoalBar() {
  const text = useText();
  const { tool, draft, preview, selected } = useMapUi();
  // Subscribed to before a goal is sent, so that it is known which goals came later.
  const status = useTopicValue(TOPICS.NAVIGATE_STATUS, useGoalStatus());
  useEffect(() => {
    if (tool === "move") return;
    const onKey = (event: KeyboardEvent) => event.key === "Escape" && dropDraft();
    window.addEventListener("keydown", onKey);
    return () => window.removeEventListener("keydown", onKey);
  }, [tool]);
  if (draft !== null) return <DraftBar draft={draft} preview={preview} />;
  if (tool !== "move") {
    const hint: Record<Exclude<typeof tool, "move">, string> = {
      goal: text("map_goal_hint"),
      relocate: text("map_relocate_hint"),
      approach: selected === null ? text("map_approach_no_tag") : text("map_approach_hint", { tag: selected }),
    };
    return (
      <Bar>
        <p className="px-1">{hint[tool]}</p>
        <Button size="small" onClick={dropDraft}>
          {text("map_drop")}
        </Button>
      </Bar>
    );
  }
  return <Progress status={status} />;
}

/** Takes the status of the goal that this page sent last. */
function useGoalStatus() {
  const sent = useMapUi((state) => state.sent);
  return (sample: Sample<action_msgs_GoalStatusArray> | undefined) => (sent === null ? null : statusSince(sample?.message.status_list ?? [], sent.known));
}

function Bar({ children, className }: { children: ReactNode; className?: string }) {
  return (
    <div role="group" className={cn("pointer-events-auto flex max-w-full flex-wrap items-center justify-center gap-x-4 gap-y-2 rounded-lg border border-line-strong bg-panel px-3 py-2", className)}>
      {children}
    </div>
  );
}

const SEND: Record<Draft["kind"], TextKey> = { goal: "map_send_goal", relocate: "map_send_relocate", approach: "map_keep_approach" };

function DraftBar({ draft, preview }: { draft: Draft; preview: Preview | null }) {
  const text = useText();
  const { pose, kind } = draft;
  const goalObstacle = useMotionObstacles()[0];
  const relocationObstacle = useRelocationObstacles()[0];
  const navigates = useNavigates();
  const obstacle = kind === "goal" ? goalObstacle : kind === "relocate" ? relocationObstacle : undefined;
  const place = { x: fixed(pose.x, 2), y: fixed(pose.y, 2), tag: draft.name ?? "" };
  // SLAM does not listen: the console has it load its map again, with the robot elsewhere.
  const isSlam = useIsHeard(TOPICS.INITIAL_POSE.name) === false;
  const canSend = obstacle === undefined && (kind !== "approach" || draft.name !== undefined);
  const title =
    kind === "goal"
      ? draft.name === undefined
        ? text("map_goal_place", place)
        : text("map_goal_named", { name: draft.name })
      : text(kind === "relocate" ? "map_relocate_place" : "map_approach_place", place);
  const send = () => {
    if (kind === "goal") sendGoal(pose).catch(showProblem);
    if (kind === "relocate") (isSlam ? relocate(pose) : sendInitialPose(pose)).then(() => showDone(text("map_relocated")), showProblem);
    const tag = draft.name;
    if (kind === "approach" && tag !== undefined) changeApproach(tag, pose).then(() => showDone(text("map_approach_stored", { tag })), showProblem);
  };
  // The map's Enter key does what the button does, from the moment that it is shown, and nothing where it is disabled.
  useLayoutEffect(() => {
    draftSender.send = canSend ? send : null;
    return () => {
      draftSender.send = null;
    };
  });
  return (
    <Bar>
      <div className="min-w-0">
        <p className="font-semibold">
          {title} <span className="font-normal text-text-2 numeric">{fixed(toDegrees(pose.yaw), 0)}°</span>
        </p>
        {kind === "goal" && <PathLine preview={preview} />}
        {kind === "goal" && canSend && navigates && <p className="text-xs text-attention">{text("map_replaces_goal")}</p>}
        {obstacle !== undefined && <p className="text-xs text-attention">{text("map_blocked", { reason: text(obstacle.key, obstacle.values) })}</p>}
      </div>
      <div className="flex gap-2">
        <Button kind="primary" disabled={!canSend} onClick={send} data-testid="send-pose">
          {kind === "goal" ? <Navigation /> : <Check />}
          {text(SEND[kind])}
        </Button>
        <Button onClick={dropDraft}>
          <X />
          {text("map_drop")}
        </Button>
      </div>
    </Bar>
  );
}

function PathLine({ preview }: { preview: Preview | null }) {
  const text = useText();
  if (preview === null || (preview.isPending && preview.points.length === 0)) return <p className="text-xs text-text-2">{text("map_asking_path")}</p>;
  if (preview.problem !== null) return <p className="text-xs text-attention">{text(preview.problem)}</p>;
  return <p className="text-xs text-text-2">{text("map_path_length", { length: writeLength(lengthOf(preview.points)) })}</p>;
}

/** A goal that this page sent, or that another client sent outside of a mission. */
function Progress({ status }: { status: number | null }) {
  const text = useText();
  const now = useNow();
  const sent = useMapUi((state) => state.sent);
  const language = useLanguage((store) => store.language);
  const refusal = useLink((link) => link.refusal);
  const mission = useMissionState();
  const isInMission = mission !== null && isRunning(mission) && !mission.paused;
  const { plan, pose } = liveMap;
  const planAge = plan === null ? Infinity : now - plan.receivedMs;
  const shown = shownPlan(plan, pose, now);
  const isDriving = shown?.isFollowed === true;
  const progress = sent === null ? null : goalProgress(now - sent.atMs, status);
  const besideM = sent === null ? null : besideGoalM(sent.pose, now - sent.atMs, { end: plan?.points.at(-1) ?? null, ageMs: planAge });
  useEffect(() => {
    if (isInMission) useMapUi.setState({ sent: null });
  }, [isInMission]);
  if (isInMission || (sent === null && !isDriving)) return null;
  if (sent !== null && (progress === "reached" || progress === "ended")) {
    return (
      <Bar>
        <p className={cn("flex items-center gap-2", progress === "reached" && besideM === null ? "text-alive" : "text-attention")}>
          {progress === "reached" && <Check aria-hidden="true" className="size-4" />}
          {progress === "ended" ? text("map_goal_ended") : besideM === null ? text("map_goal_reached") : text("map_goal_reached_beside", { length: writeLength(besideM) })}
        </p>
        <Button size="small" onClick={() => useMapUi.setState({ sent: null })}>
          {text("map_dismiss")}
        </Button>
      </Bar>
    );
  }
  if (sent !== null && refusal !== null && refusal.receivedMs > sent.atMs && progress !== "driving") {
    return (
      <Bar>
        <p className="text-attention">{text("map_goal_refused", { reason: wordsIn(language, refusal.text).slice(0, 200) })}</p>
        <Button size="small" onClick={() => useMapUi.setState({ sent: null })}>
          {text("map_dismiss")}
        </Button>
      </Bar>
    );
  }
  const waited = sent === null ? "" : formatDuration((now - sent.atMs) / 1000);
  const left = isDriving ? text("map_goal_left", { length: writeLength(lengthOf(shown.left)) }) : "";
  return (
    <Bar>
      <p>
        {progress === "sent" ? (
          text("map_goal_sent", { age: waited })
        ) : progress === "unanswered" ? (
          <span className="text-attention">{text("map_goal_unanswered", { age: waited })}</span>
        ) : (
          <>
            <strong className="font-semibold">{text("map_goal_driving")}</strong> <span className="text-text-2">{left}</span>
            {besideM !== null && <span className="block text-xs text-attention">{text("map_goal_beside", { length: writeLength(besideM) })}</span>}
          </>
        )}
      </p>
      <Button onClick={cancelNavigation} data-testid="cancel-goal">
        <X />
        {text("map_cancel_goal")}
      </Button>
    </Bar>
  );
}
