// @vitest-environment jsdom
import { beforeEach, describe, expect, it } from "vitest";
import { noteStop, noteVelocity, usePublishLog } from "./publish_log";

const noted = () => usePublishLog.getState().publications.map(({ topic, text }) => `${topic} ${text}`).toReversed();

describe("the log of what was sent", () => {
  beforeEach(() => usePublishLog.setState({ publications: [] }));

  it("has velocities where they change, and not those that are repeated", () => {
    noteVelocity("/v", { x: 0 }, false, true, 0);
    noteVelocity("/v", { x: 0 }, false, true, 50);
    noteVelocity("/v", { x: 0.1 }, true, true, 100);
    noteVelocity("/v", { x: 0.2 }, true, true, 150);
    noteVelocity("/v", { x: 0.3 }, true, true, 1200);
    noteVelocity("/v", { x: 0 }, false, true, 1250);
    expect(noted()).toEqual(['/v {"x":0}', '/v {"x":0.1}', '/v {"x":0.3}', '/v {"x":0}']);
  });

  it("has stops and releases once", () => {
    noteStop("/stop", false, true);
    noteStop("/stop", true, false);
    noteStop("/stop", true, true);
    noteStop("/stop", true, true);
    noteStop("/stop", false, true);
    expect(noted()).toEqual(['/stop {"data":true}', '/stop {"data":true}', '/stop {"data":false}']);
    expect(usePublishLog.getState().publications.at(-1)?.sent).toBe(false);
  });
});
