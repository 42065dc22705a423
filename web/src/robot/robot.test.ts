// @vitest-environment jsdom
/** Every command of the page, in every state of its gate and of control: what it sends to the server. */
import { beforeEach, describe, expect, it, vi } from "vitest";
import type { ConsoleState } from "@/api/console_store";
import { ACTIONS, JOINT_SERVICES, SERVICES, TOPICS } from "@/generated/graph";

const OWN = "laptop-1";
const HOLDERS = { own: OWN, other: "phone-2", nobody: null } as const;
type Holder = keyof typeof HOLDERS;

/** How the gate comes into a state, from open and in control. */
const GATES = ["startup", "open", "stopped", "withdrawn", "released by another", "control lost", "left the window"] as const;
type Gate = (typeof GATES)[number];
/** What a page that holds a stop repeats while anybody has control. */
const STATED: readonly Gate[] = ["stopped", "left the window"];

type Frame = Record<string, unknown> & { op: string; topic?: string; service?: string; msg?: { data?: boolean } };

let frames: Frame[] = [];
const sockets: FakeSocket[] = [];

class FakeSocket {
  static readonly OPEN = 1;
  binaryType = "";
  readyState = 1;
  onopen: (() => void) | null = null;
  onclose: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;

  constructor(readonly url: string | URL = "") {
    sockets.push(this);
  }

  send(text: string): void {
    const frame = JSON.parse(text) as Frame;
    frames.push(frame);
    if (frame.op !== "call_service") return;
    // A server that answered no ping would be given up.
    const values = frame.service === SERVICES.GET_TIME.name ? { time: { sec: 0, nanosec: 0 } } : {};
    queueMicrotask(() => this.onmessage?.({ data: JSON.stringify({ op: "service_response", id: frame["id"], values, result: true }) }));
  }

  close(): void {}
}

const topicRows = Object.entries(TOPICS).filter(([name, row]) => row.console === "operator" && !["CMD_VEL_MANUAL", "HMI_ESTOP"].includes(name));
const serviceRows = [...Object.entries(SERVICES), ...Object.entries(JOINT_SERVICES)].filter(([, row]) => row.console === "operator");
const COMMANDS = [...topicRows.map(([name, row]) => ({ name, row, kind: "topic" as const })), ...serviceRows.map(([name, row]) => ({ name, row, kind: "service" as const }))];

/** Load the page's modules anew. */
async function importRobot() {
  return { ...(await import("./start")), ...(await import("./stop")), ...(await import("./commands")), ...(await import("./driving")) };
}

async function openPage(gateState: Gate, holder: Holder) {
  vi.resetModules();
  const robot = await importRobot();
  const { useConsole: store } = await import("@/api/console_store");
  const { useTabRole } = await import("@/safety/commanding_tab");
  robot.startRobot();
  useTabRole.setState({ role: "commanding" });
  const give = (name: string | null) => store.setState({ control: { holder: name, since_s: null, requester: null } });
  store.setState({ session: { name: OWN, role: "operator" }, sessionLoaded: true, online: true });
  sockets.at(-1)?.onopen?.();
  if (gateState === "control lost") {
    give(OWN);
    robot.gate.release();
    give(HOLDERS.other);
  } else {
    give(gateState === "left the window" ? OWN : HOLDERS[holder]);
    if (gateState !== "startup") robot.gate.release();
    if (gateState === "left the window") robot.gate.engage("window-blur");
    if (["stopped", "withdrawn", "released by another"].includes(gateState)) robot.stop();
    if (gateState === "withdrawn") robot.withdrawStop();
    if (gateState === "released by another") status(robot.gate.press);
  }
  give(HOLDERS[holder]);
  frames = [];
  return { robot, give };
}

function status(id: string): void {
  sockets.at(-1)?.onmessage?.({ data: JSON.stringify({ op: "status", level: "warning", msg: "phone-2", id }) });
}

function velocities(): Frame[] {
  return frames.filter(({ op, topic }) => op === "publish" && topic === TOPICS.CMD_VEL_MANUAL.name);
}

function stops(): Frame[] {
  return frames.filter(({ op, topic, msg }) => op === "publish" && topic === TOPICS.HMI_ESTOP.name && msg?.data === true);
}

beforeEach(() => {
  vi.useFakeTimers();
  localStorage.clear();
  vi.stubGlobal("WebSocket", FakeSocket);
  vi.stubGlobal("BroadcastChannel", class {
    postMessage(): void {}
  });
  vi.stubGlobal("fetch", () => new Promise(() => {}));
  vi.stubGlobal("Worker", undefined);
});

describe("the one gate of the page", () => {
  it("knows every command", () => {
    expect(COMMANDS.length).toBeGreaterThan(20);
    expect(COMMANDS.filter(({ row }) => row.moves).length).toBeGreaterThan(10);
    const goals = Object.values(ACTIONS).filter((row) => row.console === "operator");
    expect(goals.every((row) => row.moves)).toBe(true);
  });

  describe.each(GATES)("%s", (gateState) => {
    it.each(Object.keys(HOLDERS) as Holder[])("with control: %s", async (holder) => {
      const { robot, give } = await openPage(gateState, holder);
      // Where control was lost to somebody else, the gate is closed; otherwise it is as it was brought about.
      const isClosed = robot.gate.engaged;
      expect(isClosed).toBe(gateState !== "open");
      const { press } = robot.gate;
      const isStated = STATED.includes(gateState);
      expect(robot.gate.isStated).toBe(isStated);

      for (const { name, row, kind } of COMMANDS) {
        frames = [];
        let refusal: unknown = null;
        try {
          if (kind === "topic") robot.publish(row as typeof TOPICS.GOAL_POSE, {});
          else void robot.call(row as typeof SERVICES.MISSION_PAUSE, {}).catch((error: unknown) => (refusal = error));
        } catch (error) {
          refusal = error;
        }
        await vi.advanceTimersByTimeAsync(0);
        const isSent = frames.some((frame) => (kind === "topic" ? frame.op === "publish" && frame.topic === row.name : frame.service === row.name));
        expect([name, isSent], name).toEqual([name, !(row.moves && isClosed)]);
        if (row.moves && isClosed) expect((refusal as Error).constructor.name).toBe("CommandRefused");

        // The server gives control to whoever commands, where it is free.
        if (holder === "nobody" && isSent) give(OWN);
        frames = [];
        await vi.advanceTimersByTimeAsync(1000);
        expect([name, velocities().length > 0], name).toEqual([name, isStated && (holder === "own" || (holder === "nobody" && isSent))]);
        expect([name, stops().length > 0], name).toEqual([name, isStated]);
        expect([robot.gate.engaged, robot.gate.isStated, robot.gate.press], name).toEqual([isClosed, isStated, press]);
        give(HOLDERS[holder]);
        if (holder === "nobody" && gateState === "open") robot.gate.release();
      }
    });
  });

  it.each(GATES.filter((each) => each !== "open"))("lets no stick through: %s", async (gateState) => {
    const { robot } = await openPage(gateState, "own");
    robot.driver.hold("keyboard", { x: 0.3, y: 0, yaw: 0 });
    await vi.advanceTimersByTimeAsync(1000);
    const speeds = velocities().map(({ msg }) => (msg as unknown as { linear: { x: number } }).linear.x);
    expect(speeds.every((speed) => speed === 0)).toBe(true);
    robot.driver.hold("keyboard", { x: 0, y: 0, yaw: 0 });
  });

  it("sends nothing more once control is given up", async () => {
    const { robot, give } = await openPage("startup", "own");
    await vi.advanceTimersByTimeAsync(1000);
    frames = [];
    give(null);
    await vi.advanceTimersByTimeAsync(1000);
    expect([velocities(), frames.filter(({ op }) => op === "publish")]).toEqual([[], []]);
    expect(robot.gate.engaged).toBe(true);
  });

  it("believes no word about another press", async () => {
    const { robot } = await openPage("stopped", "other");
    const { press } = robot.gate;
    robot.stop();
    status(press);
    expect([robot.gate.isStated, robot.gate.press === press]).toEqual([true, false]);
    status(robot.gate.press);
    expect([robot.gate.isStated, robot.gate.engaged]).toEqual([false, true]);
  });
});

describe("a page on another robot's rosbridge", () => {
  async function openElsewhere() {
    localStorage.setItem("lupin-hmi-settings/v5", JSON.stringify({ rosUrl: "ws://192.0.2.7:9090" }));
    const asked: [string, unknown][] = [];
    vi.stubGlobal("fetch", (path: string, { body }: RequestInit = {}) => {
      asked.push([path, body === undefined ? null : JSON.parse(String(body))]);
      const session = { name: OWN, role: "operator" };
      return Promise.resolve(Response.json(path === "/_api/session" ? { session, control: { holder: OWN, since_s: null, requester: null }, stop: [] } : { stop: [] }));
    });
    vi.resetModules();
    const robot = await importRobot();
    robot.startRobot();
    await vi.advanceTimersByTimeAsync(100);
    sockets.findLast((socket) => String(socket.url).includes("192.0.2.7"))?.onopen?.();
    await vi.advanceTimersByTimeAsync(100);
    frames = [];
    asked.length = 0;
    return { robot, asked };
  }

  it("watches: no command, no velocity, no release, although its browser has control", async () => {
    const { robot, asked } = await openElsewhere();
    for (const { row } of COMMANDS) expect(() => robot.checkCommand(row)).toThrow("elsewhere_no_command");
    robot.driver.hold("keyboard", { x: 0.3, y: 0, yaw: 0 });
    await expect(robot.release()).rejects.toThrow("elsewhere_no_command");
    robot.gate.engage("window-blur");
    await vi.advanceTimersByTimeAsync(7000);
    expect(frames.filter(({ op }) => op === "publish")).toEqual([]);
    expect(asked.filter(([path]) => path === "/_api/stop")).toEqual([]);
    expect([robot.driveBlocker(), robot.gate.engaged]).toEqual(["viewer", true]);
  });

  it("stops both robots, holds the wheels of none, and takes back its own stop at both", async () => {
    const { robot, asked } = await openElsewhere();
    robot.stop();
    await vi.advanceTimersByTimeAsync(2000);
    const { press } = robot.gate;
    expect(stops().length).toBeGreaterThan(2);
    expect(velocities()).toEqual([]);
    const told = () => asked.filter(([path]) => path === "/_api/stop").map(([, body]) => body);
    expect(told()).toEqual([{ engaged: true, press }]);
    robot.withdrawStop();
    await vi.advanceTimersByTimeAsync(100);
    expect(frames.findLast(({ topic }) => topic === TOPICS.HMI_ESTOP.name)?.msg?.data).toBe(false);
    expect(told().at(-1)).toEqual({ engaged: false, press });
  });
});

describe("the release", () => {
  const phone = (press: string): ConsoleState["stop"][number] => ({ kind: "pressed", text: "", press, name: "phone-2", age_s: 0 });

  it("names this browser's stops, and those of others that were shown before it was held", async () => {
    const { robot } = await openPage("stopped", "own");
    const { showStops } = await import("@/api/console_store");
    const bodies: Record<string, unknown>[] = [];
    vi.stubGlobal("fetch", (_: string, { body }: RequestInit) => {
      bodies.push(JSON.parse(String(body)) as Record<string, unknown>);
      return Promise.resolve(Response.json({ stop: [phone("press:new")] }));
    });
    showStops([phone("press:old")]);
    await vi.advanceTimersByTimeAsync(1100);
    const former = { ...phone("press:former"), name: OWN };
    showStops([phone("press:old"), phone("press:new"), former]);
    const own = robot.gate.press;
    await expect(robot.release()).rejects.toThrow("still_holds");
    expect(bodies).toEqual([{ action: "take" }, { engaged: false, presses: [own, "press:old", "press:former"] }]);
    expect(robot.gate.engaged).toBe(true);
  });

  it.each([true, false])("tells the drive bus that the sticks rest, where the robot was stopped: %s", async (wasStopped) => {
    const { robot } = await openPage("startup", "own");
    const { showStops } = await import("@/api/console_store");
    vi.stubGlobal("fetch", () => Promise.resolve(Response.json({ stop: [] })));
    if (wasStopped) showStops([phone("press:old")]);
    await vi.advanceTimersByTimeAsync(1100);
    frames = [];
    await robot.release();
    await vi.advanceTimersByTimeAsync(2000);
    expect(velocities().length).toBe(wasStopped ? 1 : 0);
    expect(robot.gate.engaged).toBe(false);
  });
});
