"use strict";

const element = (id) => document.getElementById(id);
const CAMERAS_MS = 3000;
const STALE_S = 2;
let session = null;

async function ask(path, body) {
  const options = body === undefined ? {} : {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
  };
  const response = await fetch(path, options);
  const text = await response.text();
  const answer = response.headers.get("Content-Type")?.startsWith("application/json") ? JSON.parse(text) : { error: text };
  if (!response.ok) throw new Error(answer.error);
  return answer;
}

function act(path, body) {
  element("problem").textContent = "";
  return ask(path, body).catch((error) => { element("problem").textContent = error.message; });
}

function showControl(control) {
  const mine = session !== null && control.holder === session.name;
  element("control").textContent = mine ? "You have control." : control.holder ? `${control.holder} has control.` : "Nobody has control.";
  element("take").disabled = mine || session === null || session.role !== "operator";
  element("give").disabled = !mine;
}

function showStop(reasons) {
  element("reasons").textContent = reasons.length ? `Stopped: ${reasons.join(", ")}` : "No client stops the robot.";
}

async function showCameras() {
  let cameras = [];
  try { cameras = await ask("/_video/streams"); } catch { /* show no cameras */ }
  const shown = new Map([...element("cameras").children].map((figure) => [figure.dataset.topic, figure]));
  for (const { topic, clients, age_s } of cameras) {
    const figure = shown.get(topic) ?? addCamera(topic);
    shown.delete(topic);
    const stale = clients > 0 && (age_s === null || age_s > STALE_S);
    figure.lastChild.textContent = stale ? `${topic}: no picture for ${age_s === null ? "long" : `${Math.round(age_s)} s`}` : topic;
  }
  for (const figure of shown.values()) figure.remove();
}

function addCamera(topic) {
  const figure = document.createElement("figure"), image = document.createElement("img");
  figure.dataset.topic = topic;
  image.src = `/_video/stream?topic=${encodeURIComponent(topic)}`;
  image.alt = `Picture of ${topic}`;
  image.onerror = () => figure.remove();
  figure.append(image, document.createElement("figcaption"));
  element("cameras").append(figure);
  return figure;
}

function listen() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/_api/events`);
  // A client that is silent for 5 s loses control.
  const keepAlive = setInterval(() => { if (socket.readyState === WebSocket.OPEN) socket.send("{}"); }, 1000);
  const refresh = setInterval(showCameras, CAMERAS_MS);
  socket.onopen = () => { element("problem").textContent = ""; showCameras(); };
  socket.onmessage = (message) => {
    const { event, value } = JSON.parse(message.data);
    if (event === "control") showControl(value);
    if (event === "stop") showStop(value);
  };
  socket.onclose = () => {
    clearInterval(keepAlive);
    clearInterval(refresh);
    element("cameras").replaceChildren(); // a frozen picture must not look like a live one
    element("problem").textContent = "The connection to the console is lost; the button on the robot still works.";
    setTimeout(start, 2000);
  };
}

async function start() {
  const state = await act("/_api/session");
  if (state === undefined) { setTimeout(start, 2000); return; }
  session = state.session;
  element("pairing").hidden = session !== null;
  element("paired").hidden = session === null;
  if (session === null) return;
  element("who").textContent = `This browser is ${session.name}, role ${session.role}.`;
  showControl(state.control);
  showStop(state.stop);
  listen();
}

async function pair(code) {
  if (await act("/_api/pair", { code }) !== undefined) await start();
}

element("pairing").addEventListener("submit", (event) => { event.preventDefault(); pair(element("code").value); });
element("stop").addEventListener("click", () => act("/_api/stop", { engaged: true }));
element("release").addEventListener("click", () => act("/_api/stop", { engaged: false }));
element("take").addEventListener("click", () => act("/_api/lease", { action: "take" }));
element("give").addEventListener("click", () => act("/_api/lease", { action: "give_up" }));

const scanned = new URLSearchParams(location.hash.slice(1)).get("code");
if (scanned) {
  history.replaceState(null, "", location.pathname); // removes the code from address bar and history
  pair(scanned);
} else {
  start();
}
