import { describe, expect, it } from "vitest";
import { readBoxes } from "./boxes";

const BOX = { id: "41", x: 3, y: 1, yaw: Math.PI / 2, width: 1, depth: 0.5, height: 0.3 };

describe("boxes", () => {
  it("have their front where the yaw points", () => {
    const [box] = readBoxes(JSON.stringify([BOX]));
    expect(box?.id).toBe("41");
    expect(box?.corners[0].x).toBeCloseTo(2.5);
    expect(box?.corners[0].y).toBeCloseTo(1.25);
    expect(box?.corners[2].x).toBeCloseTo(3.5);
    expect(box?.corners[2].y).toBeCloseTo(0.75);
  });

  it("come as a list or in an object, with either name of the id", () => {
    const { id: _, ...rest } = BOX;
    expect(readBoxes(JSON.stringify({ boxes: [{ ...rest, box_id: 7 }] }))[0]?.id).toBe("7");
  });

  it.each(["", "{", "null", "3", "[null, 3]", '{"boxes": 1}', '[{"id": "1"}]'])("survive %s", (text) => {
    expect(readBoxes(text)).toEqual([]);
  });
});
