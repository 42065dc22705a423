import { describe, expect, it } from "vitest";
import type { lupin_msgs_CalibrateArm_Response } from "@/generated/messages";
import { calibrationState, offsetRows } from "./calibration";

describe("the calibration", () => {
  it("lists each joint with its difference, offset and remark", () => {
    const answer = {
      message: "shoulder_lift: 3412 counts off, so it is assembled wrongly; no offset was written; elbow: offset 512",
      joint_names: ["shoulder_lift", "elbow"],
      diffs_observed: [3412, 512],
      offsets_applied: [0, 512],
    } as unknown as lupin_msgs_CalibrateArm_Response;
    expect(offsetRows(answer)).toEqual([
      { joint: "shoulder_lift", difference: 3412, offset: 0, remark: "3412 counts off, so it is assembled wrongly; no offset was written" },
      { joint: "elbow", difference: 512, offset: 512, remark: "offset 512" },
    ]);
  });

  it("survives arrays that are too short", () => {
    const answer = { message: "", joint_names: ["elbow"], diffs_observed: [], offsets_applied: [] };
    expect(offsetRows(answer as unknown as lupin_msgs_CalibrateArm_Response)[0]?.offset).toBeNaN();
  });

  it("knows two states", () => {
    expect(calibrationState("AWAITING_POSE")).toBe("AWAITING_POSE");
    expect(calibrationState("")).toBeNull();
  });
});
