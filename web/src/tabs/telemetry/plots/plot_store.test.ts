// @vitest-environment jsdom
import { beforeEach, describe, expect, it } from "vitest";
import { MAX_SERIES, addSeries, plottableTopics, removeSeries, starterFields, usePlots } from "./plot_store";

const field = (path: string) => ({ topic: "/odom", type: "nav_msgs/msg/Odometry", path });

describe("plotted fields", () => {
  beforeEach(() => usePlots.setState({ series: [] }));

  it("are added once, up to a limit, each in a style of its own", () => {
    addSeries([field("a"), field("a"), ...Array.from({ length: 20 }, (_, index) => field(`f${index}`))]);
    const { series } = usePlots.getState();
    expect(series).toHaveLength(MAX_SERIES);
    expect(new Set(series.map(({ style }) => style)).size).toBe(MAX_SERIES);
  });

  it("give back their style when they are removed", () => {
    addSeries([field("a"), field("b")]);
    removeSeries("/odom a");
    addSeries([field("c")]);
    expect(usePlots.getState().series.map(({ path, style }) => [path, style])).toEqual([["b", 1], ["c", 0]]);
  });

  it("begin with sets on the settings' topics", () => {
    expect(starterFields("speed")[0]).toEqual({ topic: "/mirte_base_controller/odom", type: "nav_msgs/msg/Odometry", path: "twist.twist.linear.x" });
    expect(starterFields("arm")).toHaveLength(4);
  });
});

describe("topics to plot", () => {
  it("are those of the table while nothing else is known, without images", () => {
    const names = plottableTopics(null).map(({ name }) => name);
    expect(names).toContain("/scan");
    expect(names).not.toContain("/camera/image_raw");
    expect(names).not.toContain("/map");
  });

  it("are those that exist, also ones that the table does not know", () => {
    const found = { topics: ["/scan", "/effort", "/untyped"], types: ["sensor_msgs/msg/LaserScan", "std_msgs/msg/Float32", ""] };
    expect(plottableTopics(found)).toEqual([
      { name: "/effort", type: "std_msgs/msg/Float32" },
      { name: "/scan", type: "sensor_msgs/msg/LaserScan" },
    ]);
  });
});
