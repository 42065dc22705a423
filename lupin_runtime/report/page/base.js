// What the other scripts share: the page's data, and small helpers.
const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
const setText = (id, words) => { $(id).textContent = words; };
document.documentElement.classList.add("scripted");

// Seconds as m:ss or h:mm:ss, with tenths where the view is zoomed far in.
const clock = (t, digits = 0) => {
  const s = Math.floor(t * 10 ** digits + 1e-6) / 10 ** digits, h = Math.floor(s / 3600), m = Math.floor(s / 60) % 60;
  const two = (n) => String(n).padStart(2, "0"), seconds = (s % 60).toFixed(digits).padStart(digits ? 3 + digits : 2, "0");
  return h ? `${h}:${two(m)}:${seconds}` : `${m}:${seconds}`;
};
// Index of the last row whose time is at or before t, or -1.
const lastIndexAt = (rows, t, key = (row) => row[0]) => {
  let low = 0, high = rows.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (key(rows[middle]) <= t) low = middle + 1; else high = middle;
  }
  return low - 1;
};

// Calls change(factor, x, y) while two fingers move apart or together on an element; x and y are the place between them, as
// shares of its width and height. Returns a function that says whether two fingers are down.
const onPinch = (element, change) => {
  const fingers = new Map();
  let before = 0;
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return { distance: Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY), x: (a.clientX + b.clientX) / 2, y: (a.clientY + b.clientY) / 2 };
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.pointerType !== "touch") return;
    fingers.set(event.pointerId, event);
    if (fingers.size === 2) before = spread().distance;
  });
  addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    fingers.set(event.pointerId, event);
    if (fingers.size !== 2) return;
    const now = spread(), box = element.getBoundingClientRect();
    change(now.distance / Math.max(1, before), (now.x - box.left) / box.width, (now.y - box.top) / box.height);
    before = now.distance;
  });
  for (const kind of ["pointerup", "pointercancel"]) addEventListener(kind, (event) => fingers.delete(event.pointerId));
  return () => fingers.size > 1;
};
