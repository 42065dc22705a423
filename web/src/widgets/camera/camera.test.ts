// @vitest-environment jsdom
import { afterEach, describe, expect, it, vi } from "vitest";
import { CameraStream, arrivalRate, medianLatencyS } from "./camera_stream";
import { cameraName, frontCamera, inOrder, parseCameras } from "./cameras";
import { className, parseFlowers, parseTags } from "./detections";
import { place } from "./marks";

describe("a stream on which nothing arrives any more", () => {
  afterEach(() => {
    vi.useRealTimers();
    vi.unstubAllGlobals();
  });

  it("is reopened", async () => {
    vi.useFakeTimers();
    const fetched = vi.fn<typeof fetch>(() => Promise.resolve(new Response(new ReadableStream({}))));
    vi.stubGlobal("fetch", fetched);
    const states: string[] = [];
    const stream = new CameraStream("/camera", { state: ({ kind }) => states.push(kind), image: () => {} });
    stream.start();
    await vi.advanceTimersByTimeAsync(19_000);
    expect(states).toEqual(["opening"]);
    await vi.advanceTimersByTimeAsync(4000);
    expect(states).toEqual(["opening", "lost", "opening"]);
    expect(fetched).toHaveBeenCalledTimes(2);
    stream.close();
  });
});

describe("tag detections", () => {
  it("are read, and what is malformed is left out", () => {
    const corners = [[10, 10], [60, 11], [59, 61], [9, 60]];
    const message = [{ id: 41, corners, dist: 0.83 }, { id: "a", corners, dist: null }, { id: 2, corners: [[1, 2]] }, null, 7, { corners }];
    expect(parseTags(JSON.stringify(message))).toEqual([
      { id: "41", corners, distanceM: 0.83 },
      { id: "a", corners, distanceM: null },
    ]);
    for (const text of ["", "{", "null", '{"id": 1}', '"tags"']) expect(parseTags(text)).toEqual([]);
  });
});

describe("flower detections", () => {
  it("are read, the surest first", () => {
    const message = [
      { class: 0, class_name: "tulip_red", confidence: 0.5, bbox_xyxy: [1, 2, 3, 4] },
      { class: 3, class_name: "bug", confidence: 0.9, bbox_xyxy: [1, 2, null, 4] },
      { confidence: null },
      7,
    ];
    expect(parseFlowers(JSON.stringify(message))).toEqual([
      { name: "bug", certainty: 0.9, box: null },
      { name: "tulip_red", certainty: 0.5, box: [1, 2, 3, 4] },
      { name: "", certainty: null, box: null },
    ]);
    expect(parseFlowers("[")).toEqual([]);
    expect(className("tulip_red")).toBe("cameras_tulip_red");
    expect(className("rose")).toBeNull();
  });
});

describe("the overlay's place", () => {
  it("is that of the image, of any size, as CSS object-fit puts it", () => {
    expect(place({ width: 640, height: 480 }, { width: 640, height: 480 }, "contain")).toEqual({ left: 0, top: 0, scale: 1 });
    expect(place({ width: 1280, height: 960 }, { width: 800, height: 480 }, "contain")).toEqual({ left: 80, top: 0, scale: 0.5 });
    expect(place({ width: 320, height: 240 }, { width: 640, height: 240 }, "cover")).toEqual({ left: 0, top: -120, scale: 2 });
  });
});

describe("the list of cameras", () => {
  const rows = parseCameras([
    { topic: "/yolo/image_detections", jpeg: false, clients: 0, fps: null, age_s: null },
    { topic: "/gripper_camera/image_raw", fps: 5, age_s: 0.1 },
    { topic: "/camera/image_raw", fps: 9.7, age_s: 0.05 },
    { name: "no topic" },
    null,
  ]);

  it("is read and ordered", () => {
    expect(parseCameras({ error: "no" })).toEqual([]);
    expect(inOrder(rows, "/camera/color/image_raw").map(({ topic }) => topic)).toEqual([
      "/camera/image_raw",
      "/gripper_camera/image_raw",
      "/yolo/image_detections",
    ]);
    expect(inOrder(rows, "/yolo/image_detections")[0]?.topic).toBe("/yolo/image_detections");
  });

  it("finds the front camera of robot and simulation", () => {
    expect(frontCamera(rows, "/camera/color/image_raw")).toBe("/camera/image_raw");
    expect(frontCamera(rows, "/gripper_camera/image_raw")).toBe("/gripper_camera/image_raw");
    expect(frontCamera(null, "/camera/color/image_raw")).toBe("/camera/color/image_raw");
    expect(frontCamera([], "/mine")).toBe("/mine");
    expect(cameraName("/mine", "/mine")).toBe("front_camera");
    expect(cameraName("/other", "/mine")).toBeNull();
  });
});

describe("the rate of images", () => {
  it("is that of the last moments", () => {
    expect(arrivalRate([], 0)).toBeNull();
    expect(arrivalRate([5], 5)).toBeNull();
    const arrivals = Array.from({ length: 40 }, (_, index) => index * 100);
    expect(arrivalRate(arrivals, 3900)).toBeCloseTo(10, 6);
    expect(arrivalRate(arrivals, 10_000)).toBeNull();
  });
});

describe("the latency of images", () => {
  const robotTime = (atMs: number) => 400 + atMs / 1000;

  it("is the usual one, by the robot's clock", () => {
    const arrivals = [100, 90, 500, 80, 110].map((latencyMs, index) => ({ receivedMs: 1000 * index, stampS: 400 + index - latencyMs / 1000 }));
    expect(medianLatencyS(arrivals, robotTime)).toBeCloseTo(0.1, 6);
    expect(medianLatencyS([{ receivedMs: 0, stampS: 400.02 }], robotTime)).toBe(0);
  });

  it("is not known without stamps, without the clock, or with clocks that differ", () => {
    expect(medianLatencyS([], robotTime)).toBeNull();
    expect(medianLatencyS([{ receivedMs: 0, stampS: null }], robotTime)).toBeNull();
    expect(medianLatencyS([{ receivedMs: 0, stampS: 400 }], () => null)).toBeNull();
    expect(medianLatencyS([{ receivedMs: 0, stampS: 1400 }], robotTime)).toBeNull();
    expect(medianLatencyS([{ receivedMs: 0, stampS: 0.5 }], robotTime)).toBeNull();
  });
});
