/** This page's stop: the gate that holds it, and how it is stated, withdrawn and released. */
import { create } from "zustand";
import { useConsole } from "@/api/console_store";
import { postJson } from "@/api/http";
import { SERVICES, TOPICS } from "@/generated/graph";
import { ZERO } from "@/safety/drive";
import { elsewhere } from "@/safety/elsewhere";
import { releaseStop } from "@/safety/release";
import { StopGate, type StopReason } from "@/safety/stop_gate";
import { StopOfConsole } from "@/safety/stop_of_console";
import { noteStop } from "@/state/publish_log";
import { showProblem } from "@/state/problems";
import { endHolds } from "@/ui/holds";
import { link } from "./link";
import { sendVelocity } from "./velocity";

interface GateStore {
  engaged: boolean;
  reason: StopReason | null;
  sinceMs: number;
  /** Whether this page holds a stop at the server. */
  isStated: boolean;
  /** How often a person pressed the stop of this page. */
  presses: number;
  /** Whether the stop was handed to an open link, or the server has answered it another way. */
  wasSent: boolean;
  /** When this page began to hold it (performance.now()); null while it holds none. */
  statedMs: number | null;
}

export const useGate = create<GateStore>(() => ({ engaged: true, reason: "startup", sinceMs: performance.now(), isStated: false, presses: 0, wasSent: false, statedMs: null }));

/** What an operator of such a page stops is the robot that is near too. */
const nearStop = new StopOfConsole((body) => postJson("/_api/stop", body), showProblem);

export const gate = new StopGate({
  stateStop: (engaged, press) => {
    const wasSent = link.publish(TOPICS.HMI_ESTOP.name, TOPICS.HMI_ESTOP.type, { data: engaged }, press);
    noteStop(TOPICS.HMI_ESTOP.name, engaged, wasSent);
    if (engaged && wasSent) useGate.setState({ wasSent });
    if (elsewhere() !== null) nearStop.state(engaged, press);
  },
  zero: () => sendVelocity(ZERO),
  cancelGoals,
  changed: (state) =>
    useGate.setState((before) => ({
      ...state,
      wasSent: state.isStated && (before.wasSent || link.isOpen),
      statedMs: state.isStated ? (before.statedMs ?? performance.now()) : null,
    })),
});

/** Cancel every goal of the navigation servers. Nothing waits for the answers. */
export function cancelGoals(): void {
  const everyGoal = { goal_info: { goal_id: { uuid: new Array<number>(16).fill(0) }, stamp: { sec: 0, nanosec: 0 } } };
  for (const row of [SERVICES.CANCEL_NAVIGATE_TO_POSE, SERVICES.CANCEL_NAVIGATE_THROUGH_POSES, SERVICES.CANCEL_FOLLOW_WAYPOINTS]) {
    link.call(row.name, row.type, everyGoal).catch(() => {});
  }
}

/** Stop the robot, for a person at this page. */
export function stop(reason: StopReason = "user"): void {
  endHolds();
  gate.engage(reason);
  useGate.setState(({ presses }) => ({ presses: presses + 1 }));
  stopWithoutLink();
}

/** A second way for the same word: it needs no open socket. */
function stopWithoutLink(): void {
  if (link.isOpen) return;
  postJson("/_api/stop", { engaged: true, press: gate.press })
    .then(() => useGate.setState(({ isStated }) => ({ wasSent: isStated })))
    .catch(() => {});
}

/** A stop of another browser that came while the release was held was not seen when that began. */
const SEEN_MS = 1000;

/** Take control, release this browser's stops and those of others that the operator has seen, and open the gate. Throws ApiError and TextError. */
export async function release(): Promise<void> {
  const { stop: stops, stopShownMs, session } = useConsole.getState();
  const shownBeforeMs = performance.now() - SEEN_MS;
  const seen = stops.filter(({ press, name }) => press !== null && (name === session?.name || (stopShownMs[press] ?? Infinity) <= shownBeforeMs));
  await releaseStop({ gate, postJson, restate: stopWithoutLink, seen });
  // After a stop, the drive bus passes a stick on once it has heard of it at rest, or nothing for 2 s. Where nothing was stopped,
  // a zero would hold what drives.
  if (stops.length > 0) sendVelocity(ZERO);
}

/** Let go of this page's stop. The robot stays stopped while anything else holds it. */
export function withdrawStop(): void {
  gate.withdraw();
}
