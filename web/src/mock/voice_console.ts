/** `/_api/voice` of the mock mode: the rules of the console's server for the tools that the scripts call. */
import type { MessageSocket } from "@/api/sockets";
import { FUNCTION_DECLARATIONS } from "@/generated/voice_tools";
import { whenLost } from "./link_state";
import { PageSocket, type PageServer } from "./page_socket";
import type { MockRobot } from "./services";

type Fields = Record<string, unknown>;
type Tool = (robot: MockRobot, args: Fields) => Fields;

const MAX_SAME_CALLS = 4;
const STOP_PRESS = "press:voice-agent";
const VOLTS_FULL = 12.6;
const HOME = { x: 0, y: 0, yaw: 0 };

const untrusted = (text: string) => ({ untrusted: text });

const TOOLS: Record<string, Tool> = {
  query_state: ({ world }, args) => {
    const wanted = Array.isArray(args["fields"]) ? args["fields"] : ["pose", "battery", "estop"];
    const state: Fields = {
      pose: { ...world.pose },
      battery: { voltage: VOLTS_FULL * (0.8 + 0.2 * world.batteryFraction), percentage: world.batteryFraction },
      estop: { active: world.isStopped, reasons: world.stopReasons.map(untrusted) },
    };
    return { ok: true, ...Object.fromEntries(Object.entries(state).filter(([name]) => wanted.includes(name))) };
  },
  stop: ({ world }) => {
    world.driveByHand({ x: 0, y: 0, yaw: 0 });
    return { ok: true, action: "stop" };
  },
  engage_estop: ({ authority }) => {
    authority.stopWithoutLink(STOP_PRESS);
    return { ok: true, action: "engage_estop", reason: "voice-agent" };
  },
  nav_cancel: ({ world }) => {
    world.cancelGoal();
    return { ok: true, action: "nav_cancel", response: "goals that are being canceled: 1" };
  },
  nav_goto_named: ({ world, authority }, args) => {
    if (world.isStopped) return { ok: false, error: "the e-stop is engaged; do not try again before the operator has released it", blocked: true, reasons: world.stopReasons.map(untrusted) };
    if (args["name"] !== "home") return { ok: false, error: "there is no such location" };
    authority.checkTake();
    if (args["confirmation"] === undefined) return { ok: false, confirm: "navigate to the location home", confirmation: "4f2a91c0", note: "read this back to the operator" };
    authority.take();
    world.sendGoal(HOME);
    return { ok: true, action: "goto", name: "home", ...HOME };
  },
};

/** Open a connection to the voice endpoint of the mock console. */
export function openVoiceConsole(robot: MockRobot): MessageSocket {
  return new PageSocket((socket) => {
    whenLost(robot.world.options, () => socket.closeWith(1006, ""));
    return new VoiceConsole(socket, robot);
  });
}

class VoiceConsole implements PageServer {
  private turns = 0;
  private turn = "";
  private cutOff = "";
  private readonly calls = new Map<string, number>();

  constructor(
    private readonly socket: PageSocket,
    private readonly robot: MockRobot,
  ) {}

  opened(): void {
    this.pushState();
  }

  closed(): void {}

  received(text: string): void {
    const message = JSON.parse(text) as { turn?: { id: string }; call?: { id: string; name: string; arguments: Fields }; cancel?: true };
    if (message.turn !== undefined && message.turn.id !== this.turn) {
      this.turn = message.turn.id;
      this.turns += 1;
      this.cutOff = "";
      this.calls.clear();
    }
    if (message.call !== undefined) {
      const { id, name } = message.call;
      this.socket.deliver({ result: { id, name, response: this.carryOut(name, message.call.arguments) } });
    }
    if (message.cancel === true) this.robot.world.driveByHand({ x: 0, y: 0, yaw: 0 });
    this.pushState();
  }

  private carryOut(name: string, args: Fields): Fields {
    const key = JSON.stringify([name, args]);
    this.calls.set(key, (this.calls.get(key) ?? 0) + 1);
    if ((this.calls.get(key) ?? 0) > MAX_SAME_CALLS) this.cutOff = `it called ${name} with the same arguments again and again`;
    if (this.cutOff !== "") return { ok: false, error: `cut off for this turn: ${this.cutOff}` };
    const tool = TOOLS[name];
    const isKnown = FUNCTION_DECLARATIONS.some((declaration) => declaration.name === name);
    if (tool === undefined) return { ok: false, error: isKnown ? `the mock robot does not carry out ${name}` : `there is no tool '${name}'` };
    try {
      return tool(this.robot, args);
    } catch (error) {
      return { ok: false, error: error instanceof Error ? error.message : String(error) };
    }
  }

  private pushState(): void {
    const state = { turn: this.turns, is_speaking: false, cut_off: this.cutOff, speed_cap: 1, max_linear_mps: 0.3, max_angular_rps: 0.8, is_driving: false, waiting: 0 };
    this.socket.deliver({ state });
  }
}
