/** The mock HTTP API: answers the requests that the page sends to its own origin. */
import type { SavedMaps } from "@/map/saved_maps";
import { SETTINGS, SETTINGS_VERSION } from "@/generated/settings";
import { MAX_LOG_LINES, commandRows, logText, pastLog } from "./stored_logs";
import { type MockAuthority, RequestRefused } from "./authority";
import { cameraRows, videoStream } from "./video";
import { isLost } from "./link_state";
import type { MockDoctor } from "./doctor";
import type { MockRecording } from "./recording";
import { plays, report, storedRun, storedRuns } from "./run_data";
import { type MockRobot, answerService } from "./services";
import { SERVICES } from "@/generated/graph";
import { toJson } from "./rosbridge_server";
import { say } from "./sentences";

const ANSWERS_AFTER_MS = 15;
const WINDOW = /^\/_api\/runs\/[^/]+\/recording\/window$/;

type Body = Record<string, unknown>;
type Handler = (body: Body, ...names: string[]) => unknown;

export class MockApi {
  private locations: Record<string, { x: number; y: number; yaw: number }> = {
    home: { x: 0, y: 0, yaw: 0 },
    "north row": { x: -2.2, y: 0.9, yaw: 1.57 },
    "charging station": { x: 3.4, y: -2.2, yaw: 3.14 },
  };
  private approaches: Record<string, Record<string, number>> = {};
  private settings: Record<string, unknown> = {};
  private loadedMap: string | null = null;

  constructor(
    private readonly robot: MockRobot,
    private readonly doctor: MockDoctor,
    private readonly recording: MockRecording,
    private readonly push: (event: string, value: unknown) => void,
  ) {}

  /** Answer as `fetch` would. While the link is lost, fail as it would. */
  async answer(path: string, options: RequestInit = {}): Promise<Response> {
    const url = new URL(path, location.origin);
    if (url.pathname === "/_video/stream") return videoStream(url.searchParams.get("topic") ?? "", this.robot.world, options.signal ?? null);
    await new Promise((done) => setTimeout(done, ANSWERS_AFTER_MS));
    if (isLost(this.robot.world.options)) throw new TypeError("Failed to fetch");
    const body = typeof options.body === "string" ? (JSON.parse(options.body) as Body) : null;
    try {
      if (WINDOW.test(url.pathname)) return new Response(await this.recording.window(url.searchParams), { headers: { "Content-Type": "application/cbor-seq" } });
      const value = await this.handle(url.pathname, body);
      if (value instanceof Response) return value;
      return new Response(toJson(value), { headers: { "Content-Type": "application/json" } });
    } catch (error) {
      const status = error instanceof RequestRefused ? error.status : 409;
      const text = JSON.stringify({ error: error instanceof Error ? error.message : String(error) });
      return new Response(text, { status, headers: { "Content-Type": "application/json" } });
    }
  }

  private async handle(path: string, body: Body | null): Promise<unknown> {
    const method = body === null ? "GET" : "POST";
    for (const [pattern, handler] of Object.entries(this.handlers)) {
      const [expected, template = ""] = pattern.split(" ");
      const match = new RegExp(`^${template.replaceAll("*", "([^/]+)")}$`).exec(path);
      if (expected === method && match !== null) return handler(body ?? {}, ...match.slice(1).map(decodeURIComponent));
    }
    throw new RequestRefused(`there is no ${path}`, 404);
  }

  private get authority(): MockAuthority {
    return this.robot.authority;
  }

  private readonly handlers: Record<string, Handler> = {
    "GET /_api/session": () => ({ session: this.authority.own, control: this.authority.control, stop: this.authority.stops }),
    "POST /_api/pair": () => this.authority.own,
    "GET /_api/access": () => ({
      urls: ["https://192.168.1.20:8090", "https://greenhouse.local:8090"],
      codes: this.authority.own.role === "operator" ? { operator: "K7Q2-MXPA", viewer: "W9RT-4HCN" } : {},
      serves_only_this_computer: false,
    }),
    "POST /_api/lease": ({ action, from }) => this.authority.lease(String(action), String(from ?? "")),
    "POST /_api/stop": ({ engaged, press, presses }) => ({
      stop: engaged === true ? this.authority.stopWithoutLink(String(press)) : this.authority.release(presses as string[]),
    }),
    "GET /_api/history": () => ({ events: this.authority.events, mission: [] }),
    "GET /_api/history/log": () => pastLog(this.robot.world.clockS),
    "GET /_api/doctor": () => this.doctor.state,
    "POST /_api/doctor/examination": () => this.doctor.examine(),
    "POST /_api/doctor/fix": ({ finding, confirmed }) => {
      this.authority.take();
      return this.doctor.fix(String(finding), confirmed === true);
    },
    "GET /_api/locations": () => this.locations,
    "POST /_api/locations": ({ name, pose }) => this.changeLocation(String(name).trim(), pose),
    "POST /_api/locations/import": ({ locations }) => {
      this.authority.checkTake();
      this.locations = { ...(locations as MockApi["locations"]), ...this.locations };
      this.push("locations", this.locations);
      return this.locations;
    },
    "GET /_api/settings": () => ({ version: SETTINGS_VERSION, settings: this.settings, table: [] }),
    "POST /_api/settings": ({ settings }) => this.changeSettings(settings as Body),
    "GET /_api/arm/library": () => JSON.parse(this.robot.world.library.listing()),
    "GET /_api/voice/key": () => ({ stored: false }),
    "GET /_api/maps": () => this.savedMaps(),
    "POST /_api/maps": ({ name, replace }) => {
      this.authority.take();
      if (replace !== true && this.robot.maps.has(String(name))) throw new RequestRefused(say("map_exists", { name: String(name) }), 409);
      answerService(SERVICES.SLAM_SAVE_MAP.name, { name: { data: name } }, this.robot);
      return { saved: name };
    },
    "POST /_api/maps/load": ({ name }) => {
      this.authority.take();
      if (!this.robot.maps.has(String(name))) throw new RequestRefused(say("map_not_loaded", { name: String(name), problem: say("no_such_map") }), 409);
      if (this.robot.world.mission.isRunning) throw new RequestRefused(say("map_not_loaded", { name: String(name), problem: say("mission_runs", { state: this.robot.world.mission.state(0).lifecycle_state }) }), 409);
      this.loadedMap = String(name);
      return { loaded: name };
    },
    "POST /_api/maps/delete": ({ name }) => {
      this.authority.take();
      if (name === this.loadedMap) throw new RequestRefused(say("map_not_deleted", { name: String(name), problem: say("map_is_loaded") }), 409);
      if (!this.robot.maps.delete(String(name))) throw new RequestRefused(say("map_not_deleted", { name: String(name), problem: say("no_such_map") }), 409);
      return { deleted: name };
    },
    "POST /_api/maps/relocate": ({ pose }) => {
      this.authority.take();
      this.robot.world.relocate(pose as { x: number; y: number; yaw: number });
      return { relocated: true };
    },
    "GET /_api/approaches": () => this.approaches,
    "POST /_api/approaches": ({ tag, pose }) => this.changeApproach(String(tag), pose as { x: number; y: number; yaw: number } | null),
    "GET /_api/runs": () => storedRuns(Date.now() / 1000),
    "GET /_api/runs/*": (_, id = "") => {
      const run = storedRun(id, this.robot.world, Date.now() / 1000);
      if (run === null) throw new RequestRefused("there is no such run; see /_api/runs", 404);
      return run;
    },
    "GET /_api/runs/*/report/report.html": (_, id = "") => new Response(report(id), { headers: { "Content-Type": "text/html" } }),
    "GET /_api/runs/*/logs": () => ["console", "drive", "estop", "mission", "nav", "slam"],
    "GET /_api/runs/*/logs/*": (_, _id, process = "") => new Response(logText(process, MAX_LOG_LINES), { headers: { "Content-Type": "text/plain" } }),
    "GET /_api/runs/*/commands": () => commandRows(this.authority.own.name),
    "GET /_api/plays": () => plays(),
    "GET /_api/plays/*": (_, id = "") => {
      const play = (plays() as { run: string }[]).find((each) => each.run === id);
      if (play === undefined) throw new RequestRefused("there is no such playbook run; see /_api/plays", 404);
      return { ...play, steps: [] };
    },
    "GET /_api/deployments": () => (plays() as { playbook: string }[]).filter(({ playbook }) => playbook === "deploy-robot"),
    "GET /_video/streams": () => cameraRows(this.robot.world),
  };

  private savedMaps(): SavedMaps {
    const folder = "/home/grower/.local/state/lupin/maps";
    const saved = [...this.robot.maps].toSorted();
    return {
      folder,
      loaded: this.loadedMap,
      maps: saved.map((name) => ({ name, saved_s: 1.79e9, loadable: true, command: `lupin up --map '${folder}/${name}.yaml'` })),
    };
  }

  private changeLocation(name: string, at: unknown): unknown {
    this.authority.take();
    if (name === "" || name.length > 64) throw new RequestRefused(say("bad_location_name"), 400);
    const others = Object.fromEntries(Object.entries(this.locations).filter(([each]) => each !== name));
    const home = { home: { x: 0, y: 0, yaw: 0 } };
    this.locations = { ...home, ...others, ...(at === null ? {} : { [name]: at as MockApi["locations"][string] }) };
    this.push("locations", this.locations);
    return this.locations;
  }

  private changeApproach(tag: string, pose: { x: number; y: number; yaw: number } | null): unknown {
    this.authority.take();
    const others = Object.fromEntries(Object.entries(this.approaches).filter(([each]) => each !== tag));
    this.approaches = pose === null ? others : { ...others, [tag]: { goal_x: pose.x, goal_y: pose.y, yaw: pose.yaw } };
    this.push("approaches", this.approaches);
    return this.approaches;
  }

  private changeSettings(changes: Body): unknown {
    this.authority.checkTake();
    const unknown = Object.keys(changes).find((name) => !(name in SETTINGS));
    if (unknown !== undefined) throw new RequestRefused(`there is no setting '${unknown}'`, 400);
    Object.assign(this.settings, changes);
    this.push("settings", { ...this.settings });
    return { version: SETTINGS_VERSION, settings: this.settings };
  }
}
