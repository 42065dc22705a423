import { describe, expect, it } from "vitest";
import type { tf2_msgs_TFMessage } from "@/generated/messages";
import { MAX_HOPS, TransformTree, compose, hasMoved, wrapAngle } from "./tf";

function message(parent: string, child: string, x: number, y: number, yaw: number): tf2_msgs_TFMessage {
  return {
    transforms: [
      {
        header: { stamp: { sec: 0, nanosec: 0 }, frame_id: parent },
        child_frame_id: child,
        transform: { translation: { x, y, z: 0 }, rotation: { x: 0, y: 0, z: Math.sin(yaw / 2), w: Math.cos(yaw / 2) } },
      },
    ],
  };
}

describe("TransformTree", () => {
  it("walks from the robot to the map", () => {
    const tree = new TransformTree();
    tree.update(message("map", "odom", 1, 2, Math.PI / 2));
    tree.update(message("odom", "base_link", 3, 0, 0));
    const pose = tree.lookUp("map", "base_link");
    expect(pose?.x).toBeCloseTo(1);
    expect(pose?.y).toBeCloseTo(5);
    expect(pose?.yaw).toBeCloseTo(Math.PI / 2);
  });

  it("chains roll and pitch too, and takes names with a leading slash", () => {
    const tree = new TransformTree();
    const [rolled, link] = [message("/base_link", "mount", 1, 0, 0), message("mount", "/laser", 0, 0.5, 0.2)];
    rolled.transforms[0]!.transform.rotation = { x: 1, y: 0, z: 0, w: 0 };
    tree.update(rolled);
    tree.update(link);
    const pose = tree.lookUp("base_link", "laser");
    expect(pose?.y).toBeCloseTo(-0.5);
    expect(pose?.yaw).toBeCloseTo(-0.2);
  });

  it("has no pose without a whole chain, and ends in a cycle", () => {
    const tree = new TransformTree();
    tree.update(message("odom", "base_link", 1, 0, 0));
    expect(tree.lookUp("map", "base_link")).toBeNull();
    tree.update(message("base_link", "odom", 1, 0, 0));
    expect(tree.lookUp("map", "base_link")).toBeNull();
  });

  it("follows at most 32 transforms", () => {
    const tree = new TransformTree();
    for (let hop = 0; hop <= MAX_HOPS; hop += 1) tree.update(message(`f${hop}`, `f${hop + 1}`, 1, 0, 0));
    expect(tree.lookUp("f0", `f${MAX_HOPS}`)?.x).toBeCloseTo(MAX_HOPS);
    expect(tree.lookUp("f0", `f${MAX_HOPS + 1}`)).toBeNull();
  });

  it("passes over transforms that are not finite", () => {
    const tree = new TransformTree();
    tree.update(message("map", "base_link", NaN, 0, 0));
    expect(tree.lookUp("map", "base_link")).toBeNull();
  });
});

describe("plane poses", () => {
  it("compose and wrap", () => {
    expect(compose({ x: 1, y: 0, yaw: Math.PI }, { x: 1, y: 1, yaw: Math.PI / 2 }).yaw).toBeCloseTo(-Math.PI / 2);
    expect(wrapAngle(3 * Math.PI)).toBeCloseTo(Math.PI);
  });

  it("count as moved above 5 mm or 5 mrad", () => {
    const here = { x: 0, y: 0, yaw: 0 };
    expect(hasMoved(null, here)).toBe(true);
    expect(hasMoved(here, { x: 0.004, y: 0, yaw: 0.004 })).toBe(false);
    expect(hasMoved(here, { x: 0.006, y: 0, yaw: 0 })).toBe(true);
    expect(hasMoved(here, { x: 0, y: 0, yaw: 0.006 })).toBe(true);
  });
});
