import { describe, expect, it } from "vitest";
import { FITS_MS, findFor, keepRecent } from "./matching";

const tags = (stamp: number) => JSON.stringify([{ id: 1, corners: [], dist: 1, stamp }]);

describe("the detections for an image", () => {
  const found = [
    { text: tags(9.9), receivedMs: 1000 },
    { text: tags(10.0), receivedMs: 1100 },
    { text: "[]", receivedMs: 1200 },
    { text: tags(10.2), receivedMs: 1300 },
  ];

  it("are those of the same image, whenever they came", () => {
    expect(findFor(found, { stampS: 10.0, receivedMs: 1290 })).toBe(tags(10.0));
    expect(findFor(found, { stampS: 10.205, receivedMs: 1310 })).toBe(tags(10.2));
  });

  it("are none where the detector saw nothing in it", () => {
    expect(findFor(found, { stampS: 10.1, receivedMs: 1200 })).toBe("[]");
  });

  it("are the nearest ones to arrive where images have no stamps", () => {
    expect(findFor(found, { stampS: null, receivedMs: 1040 })).toBe(tags(9.9));
    expect(findFor([{ text: "[]", receivedMs: 0 }], { stampS: null, receivedMs: FITS_MS + 1 })).toBeNull();
  });

  it("are none where all are too old", () => {
    expect(findFor(found, { stampS: 11.0, receivedMs: 2100 })).toBeNull();
    expect(findFor([], { stampS: 11.0, receivedMs: 2100 })).toBeNull();
  });
});

it("messages of some seconds are kept, and none that come after one of the past", () => {
  const message = (receivedMs: number) => ({ text: "[]", receivedMs });
  expect(keepRecent([message(0), message(900)], message(2500)).map(({ receivedMs }) => receivedMs)).toEqual([900, 2500]);
  expect(keepRecent([message(100), message(900)], message(500)).map(({ receivedMs }) => receivedMs)).toEqual([100, 500]);
});
