/** Where the robot was a moment ago: a scan is drawn from the place where it was taken. */
import { type Pose2, wrapAngle } from "@/ros/tf";

const KEPT_S = 3;

interface Entry {
  stampS: number;
  pose: Pose2;
}

export class PoseHistory {
  private entries: Entry[] = [];

  /** The stamp of the newest pose, s of the robot's clock; null before the first. */
  get newestS(): number | null {
    return this.entries.at(-1)?.stampS ?? null;
  }

  /** Add a pose. Older stamps than the newest one are passed over, unless the robot's clock was set back. */
  add(stampS: number, pose: Pose2): void {
    const newest = this.newestS;
    if (newest !== null && stampS < newest - 1) this.entries = [];
    else if (newest !== null && stampS <= newest) return;
    this.entries.push({ stampS, pose });
    const first = this.entries.findIndex((entry) => entry.stampS >= stampS - KEPT_S);
    if (first > 0) this.entries.splice(0, first);
  }

  clear(): void {
    this.entries = [];
  }

  /** The pose at a time, between the two around it; null where that time is not covered. */
  at(stampS: number): Pose2 | null {
    const index = this.entries.findIndex((entry) => entry.stampS >= stampS);
    const after = this.entries[index];
    if (after === undefined) return null;
    if (after.stampS === stampS) return after.pose;
    const before = this.entries[index - 1];
    if (before === undefined) return null;
    const share = (stampS - before.stampS) / (after.stampS - before.stampS);
    return {
      x: before.pose.x + (after.pose.x - before.pose.x) * share,
      y: before.pose.y + (after.pose.y - before.pose.y) * share,
      yaw: wrapAngle(before.pose.yaw + wrapAngle(after.pose.yaw - before.pose.yaw) * share),
    };
  }
}
