// The time slider: map and panel show what the robot knew at the chosen time. At its end, they show the whole run.
const slider = $("time"), pose = data.pose;
const legs = [...map.querySelectorAll(".path .leg")];
const laterParts = [...map.querySelectorAll("[data-from]")];
const tags = [...map.querySelectorAll(".tag")];
const grids = [...map.querySelectorAll(".grid")];
const wholeGrids = grids.map((grid) => ["x", "y", "width", "height", "href"].map((name) => [name, grid.getAttribute(name)]));
$("now").hidden = false;

const bandsAt = (bands, t) => bands.filter(([from, to]) => from <= t && t < to + 1e-6);
const poseAt = (t) => {
  if (!pose.t.length) return null;
  const i = Math.max(0, lastIndexAt(pose.t, t * 10, (v) => v));
  return { x: pose.x[i], y: pose.y[i], yaw: pose.yaw[i] / 1000, share: pose.t.length > 1 ? i / (pose.t.length - 1) : 1 };
};
const unpackRanges = (text) => new Uint16Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
const drawScan = (t) => {
  const scans = data.scans, line = $("scan");
  const i = scans && line ? lastIndexAt(scans.rows, t) : -1;
  if (i < 0 || t - scans.rows[i][0] > 3 || t >= data.end) { if (line) line.setAttribute("d", "M0 0"); return; }
  const [at, packed] = scans.rows[i], place = poseAt(at), ranges = unpackRanges(packed);
  if (!place) return;
  const [lx, ly, lyaw] = scans.laser, c = Math.cos(place.yaw), s = Math.sin(place.yaw);
  const x = place.x + c * lx - s * ly, y = place.y - (s * lx + c * ly);
  let d = "";
  ranges.forEach((range, beam) => {
    if (!range) return;
    const angle = place.yaw + lyaw + scans.first + beam * scans.step;
    d += `M${(x + range * Math.cos(angle)).toFixed(0)} ${(y - range * Math.sin(angle)).toFixed(0)}h0`;
  });
  line.setAttribute("d", d || "M0 0");
};
// Show the map that was the newest at a time; -1: none was published yet.
let shownMap = null;
const drawMap = (t, whole) => {
  const i = whole ? null : lastIndexAt(data.maps, t, (row) => row.t);
  if (i === shownMap) return;
  shownMap = i;
  grids.forEach((grid, n) => {
    const box = i === null ? wholeGrids[n] : i < 0 ? [] : [...Object.entries(data.maps[i].box), ["href", data.maps[i][grid.dataset.theme]]];
    grid.classList.toggle("unknown-yet", !box.length);
    box.forEach(([name, value]) => grid.setAttribute(name, value));
  });
};
// The map frame's origin in canvas units.
const origin = { x: data.origin[0], y: data.origin[1] };
let listedCount = -1, shownPicture = null;
const show = (t) => {
  slider.value = t;
  setText("clock", clock(t));
  slider.setAttribute("aria-valuetext", clock(t));
  const place = poseAt(t), robot = $("robot"), whole = t >= data.end - 0.05;
  frame.classList.toggle("playing", !whole);
  $("known-at").hidden = whole;
  setText("known-clock", clock(t));
  if (place && robot) {
    robot.setAttribute("transform", `translate(${place.x} ${place.y}) rotate(${(-place.yaw * 180 / Math.PI).toFixed(1)})`);
    setText("place", `${((place.x - origin.x) / 100).toFixed(2)}, ${((origin.y - place.y) / 100).toFixed(2)} m`);
    legs.forEach((leg, i) => leg.classList.toggle("ahead", !whole && i / legs.length > place.share));
  }
  laterParts.forEach((part) => part.classList.toggle("unknown-yet", !whole && Number(part.dataset.from) > t));
  tags.forEach((tag) => tag.classList.toggle("unjudged-yet", !whole && Number(tag.dataset.judged) > t));
  drawMap(t, whole);
  drawScan(t);
  const state = bandsAt(data.states, t).pop() || data.states[data.states.length - 1];
  const flags = bandsAt(data.flags, t).map((band) => band[2]);
  setText("state", state ? [state[2], ...flags].join(" · ") : "");
  const leg = bandsAt(data.legs, t).pop();
  setText("leg", leg ? `tag ${leg[2]}, ${leg[3].toLowerCase()}` : "–");
  const speed = data.speed[lastIndexAt(data.speed, t)], battery = data.battery[lastIndexAt(data.battery, t)];
  setText("speed", speed ? `${speed[1].toFixed(2)} m/s` : "–");
  setText("battery", battery ? `${Math.round(battery[1] * 100)} %` : "–");
  setText("known", String(data.tags.filter(([at]) => at <= t).length));
  const read = lastIndexAt(data.readings, t) + 1;
  if (read !== listedCount) {
    listedCount = read;
    $("so-far").replaceChildren(...data.readings.slice(0, read).reverse().map(([at, id, words]) => {
      const item = document.createElement("li"), when = document.createElement("time"), what = document.createElement("span"), name = document.createElement("b");
      when.textContent = clock(at);
      name.textContent = `Tag ${id} `;
      what.append(name, words);
      item.append(when, what);
      return item;
    }));
  }
  const p = lastIndexAt(data.pictures, t), picture = p >= 0 && t - data.pictures[p][0] < 5 ? data.pictures[p][1] : null;
  if (picture !== shownPicture) {
    shownPicture = picture;
    $("picture").hidden = !picture;
    if (picture) $("picture").src = picture;
  }
  showChosenTime(whole ? null : t);
  const share = data.end ? t / data.end : 0;
  const track = document.querySelector("#timeline .row-track"), head = $("playhead");
  if (track && head) { head.hidden = whole; head.style.left = `${track.offsetLeft + share * track.offsetWidth}px`; }
};
chooseTime = show;

let playing = 0, previousMs = 0;
const calm = matchMedia("(prefers-reduced-motion: reduce)");  // then the replay jumps once a second
const step = (now) => {
  if (!playing) return;
  const elapsedMs = now - previousMs;
  if (calm.matches && elapsedMs < 1000) { playing = requestAnimationFrame(step); return; }
  const t = Math.min(data.end, Number(slider.value) + elapsedMs / 1000 * Number($("pace").value));
  previousMs = now;
  show(t);
  if (t >= data.end) stop(); else playing = requestAnimationFrame(step);
};
const stop = () => { cancelAnimationFrame(playing); playing = 0; setText("play", "▶"); $("play").setAttribute("aria-label", "Play"); };
$("play").addEventListener("click", () => {
  if (playing) { stop(); return; }
  if (Number(slider.value) >= data.end - 0.05) show(0);
  setText("play", "❚❚");
  $("play").setAttribute("aria-label", "Pause");
  previousMs = performance.now();
  playing = requestAnimationFrame(step);
});
slider.addEventListener("input", () => show(Number(slider.value)));
slider.addEventListener("keydown", (event) => {
  const direction = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
  if (!direction || event.ctrlKey || event.altKey || event.metaKey) return;  // the browser moves it otherwise
  event.preventDefault();
  show(clamp(Number(slider.value) + direction * (event.shiftKey ? 10 : 1), 0, data.end));
});
const now = () => Number(slider.value);
$("previous-event").addEventListener("click", () => show(data.events.filter((t) => t < now() - 0.05).pop() ?? 0));
$("next-event").addEventListener("click", () => show(data.events.find((t) => t > now() + 0.05) ?? data.end));
$("show-all").addEventListener("click", () => { stop(); show(data.end); slider.focus(); });
$("timeline").addEventListener("click", (event) => {
  const box = document.querySelector("#timeline .row-track").getBoundingClientRect();
  show(data.end * clamp((event.clientX - box.left) / box.width, 0, 1));
});
document.querySelectorAll("button[data-t]").forEach((button) => button.addEventListener("click", () => {
  show(Number(button.dataset.t));
  $("where").scrollIntoView();
}));

const requested = new URLSearchParams(location.hash.slice(1)).get("t");
show(requested === null ? data.end : clamp(Number(requested) || 0, 0, data.end));
