// Charts: the values at the pointer, and a zoom over time. All charts show the same time, so that they can be compared.
const MIN_SPAN_S = Math.min(2, data.end || 1), CLICK_PX = 5;
const span = { from: 0, to: data.end };
let pointedAt = null, chosenAt = null;
let chooseTime = () => {};  // replay.js moves its slider with it

const charts = [...document.querySelectorAll(".chart[data-chart]")].map((figure) => ({
  series: data.charts[figure.dataset.chart].series,
  unit: data.charts[figure.dataset.chart].unit,
  plot: figure.querySelector(".plot"),
  svg: figure.querySelector(".plot svg"),
  pointer: figure.querySelector(".pointer"),
  cursor: figure.querySelector(".cursor"),
  brush: figure.querySelector(".brush"),
  names: [...figure.querySelectorAll(".key")].map((key) => key.dataset.name),
  values: [...figure.querySelectorAll(".value")],
  ends: [...figure.querySelectorAll(".ends span")],
}));

// A series' value at a time; null where there is none.
const valueAt = (series, t) => {
  const i = lastIndexAt(series.t, t, (at) => at);
  if (series.shape === "stems") {
    const near = [i, i + 1].filter((k) => k >= 0 && k < series.t.length && Math.abs(series.t[k] - t) <= (span.to - span.from) / 100);
    return near.length ? Math.max(...near.map((k) => series.v[k])) : null;
  }
  return i < 0 || (series.gap && t - series.t[i] > series.gap) ? null : series.v[i];
};
const shareOf = (t) => (t - span.from) / Math.max(1e-6, span.to - span.from);
const clockDigits = () => (span.to - span.from < 20 ? 1 : 0);
const placeAt = (mark, t) => {
  const share = t === null ? -1 : shareOf(t);
  mark.hidden = share < 0 || share > 1;
  mark.style.left = `${share * 100}%`;
};
const showPointer = (t) => {
  pointedAt = t;
  for (const chart of charts) {
    placeAt(chart.pointer, t);
    const words = chart.values.map((place, i) => {
      const value = t === null ? null : valueAt(chart.series[place.dataset.series], t);
      place.textContent = t === null ? "" : value === null ? "–" : String(Number(value.toPrecision(3)));
      return `${chart.names[i]} ${value === null ? "no value" : `${place.textContent} ${chart.unit}`}`.trim();
    });
    chart.ends[1].textContent = t === null ? "" : clock(t, clockDigits());
    chart.plot.setAttribute("aria-valuenow", (t ?? span.from).toFixed(1));
    chart.plot.setAttribute("aria-valuetext", t === null ? "no time chosen" : `${clock(t, clockDigits())}: ${words.join(", ")}`);
  }
};
// Called by replay.js: mark the time of its slider in all charts; null hides the marks.
const showChosenTime = (t) => {
  chosenAt = t;
  for (const chart of charts) placeAt(chart.cursor, t);
};
const zoomCharts = (from, to) => {
  const width = clamp(to - from, MIN_SPAN_S, Math.max(MIN_SPAN_S, data.end));
  span.from = clamp(from, 0, Math.max(0, data.end - width));
  span.to = span.from + width;
  for (const chart of charts) {
    chart.svg.setAttribute("viewBox", `${600 * span.from / data.end} 0 ${600 * width / data.end} 120`);
    chart.ends[0].textContent = clock(span.from, clockDigits());
    chart.ends[2].textContent = clock(span.to, clockDigits());
    chart.plot.setAttribute("aria-valuemin", span.from.toFixed(1));
    chart.plot.setAttribute("aria-valuemax", span.to.toFixed(1));
  }
  showPointer(pointedAt === null ? null : clamp(pointedAt, span.from, span.to));
  showChosenTime(chosenAt);
};
const zoomChartsBy = (factor, share = pointedAt === null ? 0.5 : shareOf(pointedAt)) => {
  const width = clamp((span.to - span.from) / factor, MIN_SPAN_S, data.end), still = span.from + share * (span.to - span.from);
  zoomCharts(still - share * width, still - share * width + width);
};

for (const chart of charts) {
  const { plot, brush } = chart;
  const timeOf = (event) => {
    const box = plot.getBoundingClientRect();
    return span.from + clamp((event.clientX - box.left) / box.width, 0, 1) * (span.to - span.from);
  };
  let pressed = null;  // a mouse's drag: where it began
  const isPinching = onPinch(plot, (factor, x) => zoomChartsBy(factor, x));
  plot.tabIndex = 0;
  plot.setAttribute("role", "slider");
  plot.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "mouse" && event.button === 0) pressed = { x: event.clientX, t: timeOf(event) };
    showPointer(timeOf(event));
  });
  plot.addEventListener("pointermove", (event) => {
    if (isPinching()) return;
    showPointer(timeOf(event));
    brush.hidden = !pressed || Math.abs(event.clientX - pressed.x) < CLICK_PX;
    if (brush.hidden) return;
    const [left, right] = [pressed.t, pointedAt].sort((a, b) => a - b).map(shareOf);
    brush.style.left = `${left * 100}%`;
    brush.style.width = `${(right - left) * 100}%`;
  });
  plot.addEventListener("pointerleave", (event) => {
    if (event.pointerType === "mouse" && !pressed && document.activeElement !== plot) showPointer(null);
  });
  addEventListener("pointerup", (event) => {
    const from = pressed;
    pressed = null;
    if (!from || brush.hidden) return;
    brush.hidden = true;
    chart.dragged = true;  // a click follows
    zoomCharts(Math.min(from.t, timeOf(event)), Math.max(from.t, timeOf(event)));
  });
  plot.addEventListener("click", (event) => {
    if (!chart.dragged) chooseTime(timeOf(event));
    chart.dragged = false;
  });
  plot.addEventListener("dblclick", () => zoomCharts(0, data.end));
  plot.addEventListener("wheel", (event) => {
    const isSideways = Math.abs(event.deltaX) > Math.abs(event.deltaY) && span.to - span.from < data.end;
    if (!event.ctrlKey && !isSideways) return;  // the page scrolls
    event.preventDefault();
    if (event.ctrlKey) zoomChartsBy(Math.exp(-event.deltaY / 300), shareOf(timeOf(event)));
    else { const by = event.deltaX / plot.clientWidth * (span.to - span.from); zoomCharts(span.from + by, span.to + by); }
  }, { passive: false });
  plot.addEventListener("focus", () => { if (pointedAt === null) showPointer(chosenAt === null ? span.from : clamp(chosenAt, span.from, span.to)); });
  plot.addEventListener("blur", () => showPointer(null));
  plot.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const at = pointedAt ?? span.from, step = (span.to - span.from) / (event.shiftKey ? 10 : 100);
    const move = (t) => {
      const by = Math.max(0, t - span.to) + Math.min(0, t - span.from);  // at the edge, the view moves along
      pointedAt = clamp(t, 0, data.end);
      zoomCharts(span.from + by, span.to + by);
    };
    const actions = {
      ArrowLeft: () => move(at - step), ArrowRight: () => move(at + step), Home: () => move(span.from), End: () => move(span.to),
      "+": () => zoomChartsBy(2), "=": () => zoomChartsBy(2), "-": () => zoomChartsBy(0.5), 0: () => zoomCharts(0, data.end),
      Enter: () => chooseTime(at),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  });
}
if (charts.length) {
  $("charts-in").addEventListener("click", () => zoomChartsBy(2));
  $("charts-out").addEventListener("click", () => zoomChartsBy(0.5));
  $("charts-all").addEventListener("click", () => zoomCharts(0, data.end));
  zoomCharts(0, data.end);
}
