// The map: its layers, and a zoom with buttons, keys, wheel, mouse and fingers.
const frame = $("map-frame"), map = $("map"), stage = document.querySelector(".stage");

$("by").addEventListener("change", () => {
  const bySpeed = $("by").value === "speed";
  frame.classList.toggle("by-speed", bySpeed);
  stage.querySelectorAll(".path-legend").forEach((row) => { row.style.display = row.classList.contains(bySpeed ? "by-speed" : "by-time") ? "flex" : "none"; });
});
$("heat").addEventListener("change", () => {
  const sensor = $("heat").value;
  stage.querySelectorAll(".heat, .heat-legend").forEach((part) => {
    part.style.display = sensor && part.classList.contains(`heat-${sensor}`) ? (part.classList.contains("heat") ? "inline" : "flex") : "none";
  });
});
document.querySelectorAll("[data-layer]").forEach((box) => {
  const apply = () => frame.classList.toggle(box.dataset.layer === "truth" ? "show-truth" : `hide-${box.dataset.layer}`, box.checked === (box.dataset.layer === "truth"));
  box.addEventListener("change", apply);
  apply();
});

const [, , fullWidth, fullHeight] = map.getAttribute("viewBox").split(" ").map(Number);
let view = { x: 0, y: 0, k: 1 };
const applyView = () => {
  const w = fullWidth / view.k, h = fullHeight / view.k;
  view.x = clamp(view.x, 0, fullWidth - w);
  view.y = clamp(view.y, 0, fullHeight - h);
  map.setAttribute("viewBox", `${view.x} ${view.y} ${w} ${h}`);
  frame.classList.toggle("zoomed", view.k > 1);
};
const zoomMap = (factor, px = 0.5, py = 0.5) => {
  const k = clamp(view.k * factor, 1, 12);
  view.x += px * fullWidth * (1 / view.k - 1 / k);
  view.y += py * fullHeight * (1 / view.k - 1 / k);
  view.k = k;
  applyView();
};
const moveMap = (x, y) => { view.x += x; view.y += y; applyView(); };
const showWholeMap = () => { view = { x: 0, y: 0, k: 1 }; applyView(); };
$("zoom-in").addEventListener("click", () => zoomMap(1.5));
$("zoom-out").addEventListener("click", () => zoomMap(1 / 1.5));
$("zoom-reset").addEventListener("click", showWholeMap);
frame.addEventListener("wheel", (event) => {
  if (!event.ctrlKey && view.k === 1) return;
  event.preventDefault();
  const box = map.getBoundingClientRect();
  zoomMap(Math.exp(-event.deltaY / 300), (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
}, { passive: false });
frame.tabIndex = 0;
frame.addEventListener("keydown", (event) => {
  if (event.target !== frame || event.ctrlKey || event.altKey || event.metaKey) return;
  const step = 0.15 * fullWidth / view.k;
  const actions = {
    "+": () => zoomMap(1.5), "=": () => zoomMap(1.5), "-": () => zoomMap(1 / 1.5), 0: showWholeMap,
    ArrowLeft: () => moveMap(-step, 0), ArrowRight: () => moveMap(step, 0), ArrowUp: () => moveMap(0, -step), ArrowDown: () => moveMap(0, step),
  };
  if (!actions[event.key] || (event.key.startsWith("Arrow") && view.k === 1)) return;  // the page scrolls
  event.preventDefault();
  actions[event.key]();
});

const isPinchingMap = onPinch(frame, zoomMap);
let drag = null;
frame.addEventListener("pointerdown", (event) => { if (view.k > 1) drag = { x: event.clientX, y: event.clientY }; });
addEventListener("pointermove", (event) => {
  if (!drag || isPinchingMap()) { drag = null; return; }
  const scale = fullWidth / view.k / map.getBoundingClientRect().width;
  moveMap((drag.x - event.clientX) * scale, (drag.y - event.clientY) * scale);
  drag = { x: event.clientX, y: event.clientY };
});
for (const kind of ["pointerup", "pointercancel"]) addEventListener(kind, () => { drag = null; });
