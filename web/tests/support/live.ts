/** A running console and its run, for the tests of `tests/live`: they see the page as a person does, and the robot as it truly moves. */
import { readFileSync } from "node:fs";
import net from "node:net";
import path from "node:path";
import { type BrowserContext, type Page, expect } from "@playwright/test";
import { TABS, hold } from "./page";

export const CONSOLE = process.env["LUPIN_CONSOLE"] ?? "";
/** The directory of the simulator's run that the console serves. */
const RUN = process.env["LUPIN_RUN"] ?? "";

function read<Content>(name: string): Content {
  return JSON.parse(readFileSync(path.join(RUN, name), "utf8")) as Content;
}

/** The largest of the robot's true velocities, m/s and rad/s, as the simulator wrote them within about a second. */
export function speed(): number {
  return Math.max(...read<{ twist: number[] }>("sim_state.json").twist.map(Math.abs));
}

/** What the simulator wrote last, within about a second: the true pose, what the servos measure, the strip's color, and the charge. */
export interface Truth {
  pose: { x: number; y: number; yaw: number };
  servos_rad: number[];
  led_color: number[];
  battery: number;
}

export function truth(): Truth {
  return read<Truth>("sim_state.json");
}

/** The world of the simulator: where the robot began, which is the origin of its map, and its tags. */
export function world(): { start: { x: number; y: number; yaw: number }; tags: { id: number; x: number; y: number }[] } {
  return read("truth.json");
}

/** What the console has journaled. */
export function journal(): { what: string; refused?: string }[] {
  const lines = readFileSync(path.join(RUN, "console_commands.jsonl"), "utf8").trim().split("\n");
  return lines.map((line) => JSON.parse(line) as { what: string; refused?: string });
}

/** Tell the voice service what it hears in the next utterances. */
export async function willHear(sentences: readonly string[]): Promise<void> {
  const answer = await fetch(`${process.env["LUPIN_VOICE_SERVICE"] ?? ""}/heard`, { method: "POST", body: JSON.stringify(sentences) });
  expect(answer.ok).toBe(true);
}

export async function untilMoving(): Promise<void> {
  await expect.poll(speed, { message: "the robot moves" }).toBeGreaterThan(0.05);
}

export async function untilAtRest(): Promise<void> {
  await expect.poll(speed, { message: "the robot is at rest" }).toBeLessThan(0.01);
}

/** Expect that the robot does not begin to move for longer than the simulator takes to say so. */
export async function staysAtRest(page: Page): Promise<void> {
  for (let second = 0; second < 3; second += 1) {
    await page.waitForTimeout(1000);
    expect(speed()).toBeLessThan(0.01);
  }
}

/** The console's process; it describes itself again once it was replaced. */
export function consolePid(): number {
  return read<{ pid: number }>("console.json").pid;
}

export async function untilReplaced(pid: number): Promise<void> {
  await expect.poll(consolePid, { message: "another console", timeout: 60_000 }).not.toBe(pid);
}

/** Open a tab of the page, without the boot handshake. Returns its errors, which no fault of the link may cause. */
export async function openLive(page: Page, tab: (typeof TABS)[number], url = CONSOLE): Promise<string[]> {
  const errors: string[] = [];
  page.on("pageerror", (error) => errors.push(error.message));
  await page.addInitScript(() => sessionStorage.setItem("lupin-booted", "1"));
  await page.goto(`${url}/#${tab}`);
  await untilLive(page);
  return errors;
}

/** Wait until the page has its link, and hears the robot's e-stop. */
export async function untilLive(page: Page): Promise<void> {
  await expect(page.getByTestId("stop")).toContainText("heard by robot 0", { timeout: 60_000 });
}

/** Take control, and release what lost pages have stopped. */
export async function takeControl(page: Page): Promise<void> {
  await hold(page, "release");
  await expect(page.getByText("You have control")).toBeVisible();
  await expect(page.getByTestId("stop")).not.toContainText("Stopped");
}

/** Hold a driving key on the tab Teleop until the robot moves. */
export async function drive(page: Page, key: string): Promise<void> {
  await expect(page.getByText("Sticks are live")).toBeVisible();
  await page.keyboard.down(key);
  await untilMoving();
}

/** The name of this browser's session. */
export async function sessionName(page: Page): Promise<string> {
  return page.evaluate(async () => ((await (await fetch("/_api/session")).json()) as { session: { name: string } }).session.name);
}

/** What the page's top bar says of the robot. */
export function sentence(page: Page) {
  return page.locator("header").getByRole("status");
}

/** A network between a browser and the console that can be cut: then it passes nothing on, and says so to nobody. */
export class Network {
  private readonly sockets = new Set<net.Socket>();
  private isCut = false;

  private constructor(private readonly server: net.Server) {}

  static async open(): Promise<Network> {
    const { hostname, port } = new URL(CONSOLE);
    const server = net.createServer();
    const network = new Network(server);
    server.on("connection", (near) => {
      const far = net.connect(Number(port), hostname);
      for (const [from, to] of [[near, far], [far, near]] as const) {
        network.sockets.add(from);
        from.on("data", (data) => void (network.isCut || to.write(data)));
        from.on("close", () => {
          network.sockets.delete(from);
          if (!network.isCut) to.destroy();
        });
        from.on("error", () => {});
      }
    });
    await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
    return network;
  }

  get url(): string {
    return `http://127.0.0.1:${(this.server.address() as net.AddressInfo).port}`;
  }

  /** Cut the network. */
  cut(): void {
    this.isCut = true;
  }

  /** Mend it: connections that were open during the cut are gone, as after a change of the access point. */
  mend(): void {
    this.isCut = false;
    for (const socket of this.sockets) socket.destroy();
  }

  close(): void {
    for (const socket of this.sockets) socket.destroy();
    this.server.close();
  }
}

/** Halt the scripts of a page, as a sleeping laptop does, while its connections stay open. The returned function wakes it. */
export async function fallAsleep(context: BrowserContext, page: Page): Promise<() => Promise<void>> {
  const session = await context.newCDPSession(page);
  await session.send("Debugger.enable");
  const paused = new Promise((resolve) => session.once("Debugger.paused", resolve));
  await session.send("Debugger.pause");
  await paused;
  return async () => {
    await session.send("Debugger.resume");
    await session.detach();
  };
}

/** Record every text that the elements of these test ids show from now on; "" while there is none. The returned function reads them. */
export async function recordTexts(page: Page, ids: readonly string[]): Promise<(id: string) => Promise<string[]>> {
  await page.evaluate((names) => {
    const texts = Object.fromEntries(names.map((id) => [id, [] as string[]]));
    const note = () => {
      for (const id of names) {
        const shown = document.querySelector<HTMLElement>(`[data-testid="${id}"]`)?.innerText.trim() ?? "";
        if (texts[id]?.at(-1) !== shown) texts[id]?.push(shown);
      }
    };
    note();
    new MutationObserver(note).observe(document.body, { subtree: true, childList: true, characterData: true });
    Object.assign(window, { recordedTexts: texts });
  }, ids);
  return (id) => page.evaluate((name) => (window as unknown as { recordedTexts: Record<string, string[]> }).recordedTexts[name] ?? [], id);
}
