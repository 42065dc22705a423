"use strict";
// The page is complete without scripts; this adds the time slider, the map's layers and its zoom.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const $ = (id) => document.getElementById(id);
  const frame = $("map-frame"), map = $("map"), slider = $("time");
  const legs = [...map.querySelectorAll(".path .leg")];
  const tags = [...map.querySelectorAll(".tag")];
  const seenAt = new Map(data.tags.map(([t, id]) => [id, t]));
  document.documentElement.classList.add("scripted");
  $("now").hidden = false;

  const clock = (t) => {
    const s = Math.floor(t), h = Math.floor(s / 3600), m = Math.floor(s / 60) % 60;
    const two = (n) => String(n).padStart(2, "0");
    return h ? `${h}:${two(m)}:${two(s % 60)}` : `${m}:${two(s % 60)}`;
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
  const bandsAt = (bands, t) => bands.filter(([from, to]) => from <= t && t < to + 1e-6);

  // -- the chosen time --------------------------------------------------------------------------------------------------
  const pose = data.pose;
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
  const text = (id, words) => { $(id).textContent = words; };
  let listedCount = -1, shownPicture = null;
  const show = (t) => {
    slider.value = t;
    text("clock", clock(t));
    slider.setAttribute("aria-valuetext", clock(t));
    const place = poseAt(t), robot = $("robot"), whole = t >= data.end - 0.05;
    if (place && robot) {
      robot.setAttribute("transform", `translate(${place.x} ${place.y}) rotate(${(-place.yaw * 180 / Math.PI).toFixed(1)})`);
      text("place", `${((place.x - origin.x) / 100).toFixed(2)}, ${((origin.y - place.y) / 100).toFixed(2)} m`);
      frame.classList.toggle("playing", !whole);
      legs.forEach((leg, i) => leg.classList.toggle("ahead", i / legs.length > place.share));
    }
    tags.forEach((tag) => tag.classList.toggle("unknown-yet", !whole && (seenAt.get(tag.dataset.tag) ?? 0) > t));
    drawScan(t);
    const state = bandsAt(data.states, t).pop() || data.states[data.states.length - 1];
    const flags = bandsAt(data.flags, t).map((band) => band[2]);
    text("state", state ? [state[2], ...flags].join(" · ") : "");
    const leg = bandsAt(data.legs, t).pop();
    text("leg", leg ? `tag ${leg[2]}, ${leg[3].toLowerCase()}` : "–");
    const speed = data.speed[lastIndexAt(data.speed, t)], battery = data.battery[Math.max(0, lastIndexAt(data.battery, t))];
    text("speed", speed ? `${speed[1].toFixed(2)} m/s` : "–");
    text("battery", battery ? `${Math.round(battery[1] * 100)} %` : "–");
    text("known", String(data.tags.filter(([at]) => at <= t).length));
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
    const p = lastIndexAt(data.pictures, t), picture = p >= 0 && t - data.pictures[p][0] < 15 ? data.pictures[p][1] : null;
    if (picture !== shownPicture) {
      shownPicture = picture;
      $("picture").hidden = !picture;
      if (picture) $("picture").src = picture;
    }
    const share = data.end ? t / data.end : 0;
    document.querySelectorAll(".cursor").forEach((cursor) => { cursor.hidden = whole; cursor.style.left = `${share * 100}%`; });
    const track = document.querySelector("#timeline .row-track"), head = $("playhead");
    if (track && head) { head.hidden = whole; head.style.left = `${track.offsetLeft + share * track.offsetWidth}px`; }
  };
  // The map frame's origin in canvas units.
  const origin = { x: data.origin[0], y: data.origin[1] };

  // -- playing -------------------------------------------------------------------------------------------------------
  let playing = 0, previousMs = 0;
  const step = (now) => {
    if (!playing) return;
    const t = Math.min(data.end, Number(slider.value) + (now - previousMs) / 1000 * Number($("pace").value));
    previousMs = now;
    show(t);
    if (t >= data.end) stop(); else playing = requestAnimationFrame(step);
  };
  const stop = () => { cancelAnimationFrame(playing); playing = 0; text("play", "▶"); $("play").setAttribute("aria-label", "Play"); };
  $("play").addEventListener("click", () => {
    if (playing) { stop(); return; }
    if (Number(slider.value) >= data.end - 0.05) show(0);
    text("play", "❚❚");
    $("play").setAttribute("aria-label", "Pause");
    previousMs = performance.now();
    playing = requestAnimationFrame(step);
  });
  slider.addEventListener("input", () => show(Number(slider.value)));
  document.querySelectorAll(".plot").forEach((plot) => plot.addEventListener("click", (event) => {
    const box = plot.getBoundingClientRect();
    show(data.end * Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)));
  }));
  $("timeline").addEventListener("click", (event) => {
    const box = document.querySelector("#timeline .row-track").getBoundingClientRect();
    show(data.end * Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)));
  });
  document.querySelectorAll(".events li").forEach((item) => item.addEventListener("click", () => show(Number(item.dataset.t))));

  // -- layers --------------------------------------------------------------------------------------------------------
  const stage = document.querySelector(".stage");
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

  // -- zoom ----------------------------------------------------------------------------------------------------------
  const [, , fullWidth, fullHeight] = map.getAttribute("viewBox").split(" ").map(Number);
  let view = { x: 0, y: 0, k: 1 };
  const applyView = () => {
    const w = fullWidth / view.k, h = fullHeight / view.k;
    view.x = Math.min(fullWidth - w, Math.max(0, view.x));
    view.y = Math.min(fullHeight - h, Math.max(0, view.y));
    map.setAttribute("viewBox", `${view.x} ${view.y} ${w} ${h}`);
    frame.classList.toggle("zoomed", view.k > 1);
  };
  const zoom = (factor, px = 0.5, py = 0.5) => {
    const k = Math.min(12, Math.max(1, view.k * factor));
    view.x += px * fullWidth * (1 / view.k - 1 / k);
    view.y += py * fullHeight * (1 / view.k - 1 / k);
    view.k = k;
    applyView();
  };
  $("zoom-in").addEventListener("click", () => zoom(1.5));
  $("zoom-out").addEventListener("click", () => zoom(1 / 1.5));
  $("zoom-reset").addEventListener("click", () => { view = { x: 0, y: 0, k: 1 }; applyView(); });
  frame.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && view.k === 1) return;
    event.preventDefault();
    const box = map.getBoundingClientRect();
    zoom(Math.exp(-event.deltaY / 300), (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
  }, { passive: false });
  let drag = null;
  frame.addEventListener("pointerdown", (event) => { if (view.k > 1) drag = { x: event.clientX, y: event.clientY }; });
  addEventListener("pointermove", (event) => {
    if (!drag) return;
    const scale = fullWidth / view.k / map.getBoundingClientRect().width;
    view.x -= (event.clientX - drag.x) * scale;
    view.y -= (event.clientY - drag.y) * scale;
    drag = { x: event.clientX, y: event.clientY };
    applyView();
  });
  addEventListener("pointerup", () => { drag = null; });

  const requested = new URLSearchParams(location.hash.slice(1)).get("t");
  show(requested === null ? data.end : Math.min(data.end, Math.max(0, Number(requested) || 0)));
})();
