import { useEffect, useRef } from "react";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { cssColor } from "@/widgets/canvas";
import { type TimeSeries, alignedWindow, bucketize } from "@/widgets/time_series";
import { axisNumber, rangeOf, timeLabel, timeSplits } from "./plot_axes";
import { type PlotSeries, STYLES } from "./plot_store";

interface PlotCanvasProps {
  label: string;
  series: readonly PlotSeries[];
  samplesOf: (id: string) => TimeSeries | null;
  windowS: number;
  /** The end of the window while the plot is paused, in seconds of performance.now(); null while it runs. */
  pausedS: number | null;
  withTimes: boolean;
}

const DRAW_MS = 80;
const PX_PER_BUCKET = 2;
const AXIS_PX = 64;

/** Lines over the last minutes. All plots of the page share one cursor. */
export function PlotCanvas({ label, series, samplesOf, windowS, pausedS, withTimes }: PlotCanvasProps) {
  const place = useRef<HTMLDivElement>(null);

  useEffect(() => {
    const element = place.current;
    if (element === null) return;
    const plot = new uPlot(options(element, series, windowS, withTimes), [[], ...series.map(() => [])] as unknown as uPlot.AlignedData, element);
    let drawnS = NaN;
    const draw = () => {
      const toS = pausedS ?? Math.max(...series.map(({ id }) => samplesOf(id)?.lastTime || -Infinity));
      if (toS === drawnS || document.hidden) return;
      drawnS = toS;
      plot.setData(dataOf(series, samplesOf, Number.isFinite(toS) ? toS : performance.now() / 1000, windowS, element.clientWidth));
    };
    draw();
    const timer = setInterval(draw, DRAW_MS);
    const observer = new ResizeObserver(() => {
      plot.setSize({ width: element.clientWidth, height: element.clientHeight });
      drawnS = NaN;
      draw();
    });
    observer.observe(element);
    return () => {
      clearInterval(timer);
      observer.disconnect();
      plot.destroy();
    };
  }, [series, samplesOf, windowS, pausedS, withTimes]);

  return <div ref={place} role="img" aria-label={label} className="absolute inset-0" />;
}

function dataOf(series: readonly PlotSeries[], samplesOf: PlotCanvasProps["samplesOf"], toS: number, windowS: number, width: number): uPlot.AlignedData {
  const count = Math.max(20, Math.floor((width - AXIS_PX) / PX_PER_BUCKET));
  const window = alignedWindow(toS, windowS, count);
  let times: number[] = [];
  const lines = series.map(({ id }) => {
    const samples = samplesOf(id);
    if (samples === null) return [];
    const buckets = bucketize(samples, window.fromS, window.toS, count);
    times = buckets.times;
    return buckets.values;
  });
  return [times, ...lines] as uPlot.AlignedData;
}

function options(element: HTMLElement, series: readonly PlotSeries[], windowS: number, withTimes: boolean): uPlot.Options {
  const font = `12px ${getComputedStyle(document.documentElement).getPropertyValue("--font-mono")}`;
  const axis = { stroke: cssColor("--color-text-3"), font, grid: { stroke: cssColor("--color-line"), width: 1 }, ticks: { show: false } };
  return {
    width: element.clientWidth,
    height: element.clientHeight,
    legend: { show: false },
    padding: [10, 20, withTimes ? 0 : 8, 0],
    cursor: { sync: { key: "plots" }, drag: { x: false, y: false }, points: { size: 7 } },
    scales: {
      x: { time: false, range: (_, min, max) => (max > min ? [max - windowS, max] : [0, windowS]) },
      y: { range: (_, min, max) => rangeOf(min, max) },
    },
    axes: [
      {
        ...axis,
        size: withTimes ? 28 : 0,
        splits: (plot, __, min, max) => timeSplits(min, max, plot.bbox.width / devicePixelRatio),
        values: (plot, splits) => splits.map((time) => (withTimes ? timeLabel(time - (plot.scales["x"]?.max ?? time)) : "")),
      },
      { ...axis, size: AXIS_PX, values: (_, splits) => splits.map(axisNumber) },
    ],
    series: [
      {},
      ...series.map(({ style }) => {
        const { color, dash } = STYLES[style % STYLES.length] ?? { color: "--color-text", dash: [] };
        return { stroke: cssColor(color), width: 1.75, points: { show: false }, ...(dash.length > 0 ? { dash: [...dash] } : {}) };
      }),
    ],
  };
}
