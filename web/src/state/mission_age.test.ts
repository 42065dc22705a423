import { expect, it } from "vitest";
import type { lupin_msgs_MissionState } from "@/generated/messages";
import { MISSION_STALE_MS, currentMission, missionDrivesAt } from "./mission_age";

const sample = (paused: boolean) => ({ message: { lifecycle_state: "INSPECTING", paused } as lupin_msgs_MissionState, receivedMs: 1000 });

it("a mission drives while its state is of now, and it is not paused", () => {
  expect(missionDrivesAt(sample(false), 1000 + MISSION_STALE_MS)).toBe(true);
  expect(missionDrivesAt(sample(true), 1000)).toBe(false);
  expect(missionDrivesAt(sample(false), 1001 + MISSION_STALE_MS)).toBe(false);
  expect(missionDrivesAt(undefined, 0)).toBe(false);
  expect(currentMission(sample(true), 1001 + MISSION_STALE_MS)).toBeNull();
});
