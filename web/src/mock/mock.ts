/** The mock mode: a robot and the console's server in the page itself, for `?mock=1`. Nothing else loads this chunk. */
import { setOnline, useConsole } from "@/api/console_store";
import { moveLocations, take } from "@/api/events";
import { loadHistory } from "@/api/history";
import type { MessageSocket } from "@/api/sockets";
import type { Socket } from "@/ros/rosbridge";
import { MockApi } from "./api";
import { MockAuthority } from "./authority";
import { MockDoctor } from "./doctor";
import { whenLost } from "./link_state";
import { readOptions } from "./options";
import { MockRecording } from "./recording";
import { RosbridgeServer } from "./rosbridge_server";
import { runState } from "./run_data";
import { openVoiceConsole } from "./voice_console";
import { openMockAgent } from "./voice_scripts";
import { World } from "./world";

const STEP_MS = 20;
const RUN_MS = 1000;
/** Time that was missed while the page was hidden is not made up for. */
const LONGEST_STEP_S = 0.1;

const options = readOptions(new URLSearchParams(location.search));
const world = new World(options);
const maps = new Set(["greenhouse", "hall"]);
let isOnline = false;

function push(event: string, value: unknown): void {
  if (isOnline) take(JSON.stringify({ event, value }));
}

const authority: MockAuthority = new MockAuthority(options, world, () => pushState());
const robot = { world, authority, maps };
const rosbridge = new RosbridgeServer(robot);
const doctor = new MockDoctor(options, (state) => push("doctor", state));
const recording = new MockRecording(world);
authority.onEvent = (event) => push("event", event);
const api = new MockApi(robot, doctor, recording, push);

function pushState(): void {
  // Called by the constructor too, before there is anybody to tell.
  if (!isOnline) return;
  push("control", authority.state);
  push("browsers", authority.browsers);
  push("stop", authority.stops);
}

/** A socket to the rosbridge of this page. */
export function openSocket(): Socket {
  return rosbridge.open();
}

/** The voice endpoint of this page's console: no other socket is opened in the mock mode. */
export function openConsoleSocket(): MessageSocket {
  return openVoiceConsole(robot);
}

/** A connection to the scripted voice agent. */
export function openVoiceAgent(): MessageSocket {
  return openMockAgent(options.voice);
}

/** Answer a request to the page's own origin, as `fetch` does. */
export function answer(path: string, request?: RequestInit): Promise<Response> {
  return api.answer(path, request);
}

/** Begin: time runs, samples are sent, and what the server pushes is taken. */
export function startServer(): void {
  let beforeMs = performance.now();
  setInterval(() => {
    const nowMs = performance.now();
    world.advance(Math.min(LONGEST_STEP_S, (nowMs - beforeMs) / 1000));
    beforeMs = nowMs;
    rosbridge.publish(nowMs);
    recording.record();
  }, STEP_MS);
  isOnline = true;
  useConsole.setState({ session: authority.own, sessionLoaded: true });
  setOnline(true);
  pushState();
  push("doctor", doctor.state);
  push("run", runState(world));
  void loadHistory();
  void Promise.all([
    answer("/_api/locations")
      .then(async (response) => push("locations", await response.json()))
      .then(moveLocations),
    answer("/_api/settings").then(async (response) => push("settings", ((await response.json()) as { settings: unknown }).settings)),
  ]).catch(() => {});
  setInterval(() => push("run", runState(world)), RUN_MS);
  // The ages of what stops the robot.
  setInterval(pushState, RUN_MS);
  whenLost(options, () => {
    isOnline = false;
    setOnline(false);
  });
}
