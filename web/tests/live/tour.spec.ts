/**
 * A tour by voice, in sentences of espeak-ng: each must have its effect in the simulator before the next one is said. What was
 * said, called and read back is written to the output folder, with pictures.
 *
 * With a model, whose service is told what it hears, the browser's microphone plays one file. The recognizer of the agent without
 * a model understands most such sentences, asks whether some were meant, and does not understand others: there a yes is said, or
 * the sentence again, as a person would do, and what is said comes from the spec when it is due.
 */
import { writeFileSync } from "node:fs";
import { type Browser, type Page, type TestInfo, chromium, expect, test } from "@playwright/test";
import { journal, openLive, sentence, staysAtRest, takeControl, truth, untilAtRest, willHear, world } from "../support/live";
import { type Spoken, canSpeak, speakWav, writeSentences } from "../support/speech_wav";

/** Silence before the first sentence of the file, in which the robot goes home and the console's listener starts. */
const LEAD_S = 40;
/** Before the fence, from where the robot sees tag 5; in the world's frame. */
const BEFORE_TAG = { x: 3.4, y: 1.0 };
const TAG = 5;
const NEAR_M = 0.3;
const SEQUENCE = "water";

interface Step {
  say: string;
  /** What a voice service would write of it, where that differs. */
  heard?: string;
  /** Silence after it in the file, for what it begins. */
  pauseS?: number;
  /** The call that it must make, with what comes of it, as the newest one. */
  call?: readonly [tool: string, state: string];
  /** Wait for what it must do; `entries` were in the transcript before it. */
  until: (page: Page, entries: number) => Promise<void>;
}

const transcript = (page: Page) => page.getByRole("region", { name: "What was said" });
const tools = (page: Page) => page.getByRole("region", { name: "Tools that were called" });
const distanceM = (to: { x: number; y: number }) => Math.hypot(truth().pose.x - to.x, truth().pose.y - to.y);

async function untilNear(place: { x: number; y: number }, timeout: number): Promise<void> {
  await expect.poll(() => distanceM(place), { message: "the robot is at its goal", timeout }).toBeLessThan(NEAR_M);
  await untilAtRest();
}

async function untilReadBack(page: Page, text: string): Promise<void> {
  await expect(page.getByTestId("voice-confirm")).toContainText(text);
}

async function untilDriven(page: Page): Promise<void> {
  await expect.poll(() => distanceM(world().start), { message: "the robot has driven" }).toBeGreaterThan(0.1);
  await expect(tools(page)).toContainText("linear_x 0.2");
  await untilAtRest();
}

/** Whatever was recognized, the agent answers, nothing is driven, and nothing moves. */
async function untilAskedAgain(page: Page, entries: number): Promise<void> {
  await expect(transcript(page).locator("li").nth(entries + 1)).toContainText("Agent");
  await expect(tools(page)).not.toContainText("linear_x");
  await staysAtRest(page);
}

async function untilSaved(page: Page): Promise<void> {
  const { start } = world();
  const saved = () => page.evaluate(async () => ((await (await fetch("/_api/locations")).json()) as Record<string, { x: number; y: number }>)["sink"] ?? null);
  await expect.poll(saved, { message: "the location sink" }).not.toBeNull();
  const sink = await saved();
  // The map's origin is where the robot began.
  expect(distanceM({ x: start.x + (sink?.x ?? 0), y: start.y + (sink?.y ?? 0) })).toBeLessThan(NEAR_M);
}

async function untilSequenceRan(): Promise<void> {
  const pan = () => truth().servos_rad[0] ?? 0;
  await expect.poll(pan, { message: "the arm leans aside", intervals: [200] }).toBeGreaterThan(0.4);
  await expect.poll(pan, { message: "the arm is back", intervals: [200] }).toBeLessThan(0.1);
}

async function untilBlue(): Promise<void> {
  await expect.poll(() => truth().led_color, { message: "the strip is blue" }).toEqual([0, 0, 255]);
}

/** The answer has the charge: in percent, or as the share that the console says. */
async function untilCharged(page: Page): Promise<void> {
  const answer = transcript(page).locator("li").filter({ hasText: /percent/ }).last();
  await expect(answer).toContainText(/\d+ percent\b|percentage [\d.]+/);
  const [, percent, share] = /(\d+) percent\b|percentage ([\d.]+)/.exec(await answer.innerText()) ?? [];
  expect(Math.abs((percent === undefined ? Number(share) : Number(percent) / 100) - truth().battery)).toBeLessThan(0.02);
}

async function untilStopped(page: Page): Promise<void> {
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  await expect(transcript(page)).toContainText("because this was heard");
  await untilAtRest();
  expect(journal().some(({ what }) => what.startsWith("voice stop heard"))).toBe(true);
}

const GO: Step = { say: "go to tag five", heard: "go to tag 5", call: ["nav_goto_named", "asks you"], pauseS: 10, until: (page) => untilReadBack(page, "tag 5") };
const AFTER_DRIVE: readonly Step[] = [
  GO,
  { say: "yes", call: ["nav_goto_named", "done"], pauseS: 45, until: () => untilNear(BEFORE_TAG, 60_000) },
  { say: "save here as sink", call: ["save_named_location", "done"], pauseS: 10, until: untilSaved },
  { say: `run the sequence ${SEQUENCE}`, call: ["arm_run_sequence", "asks you"], pauseS: 10, until: (page) => untilReadBack(page, SEQUENCE) },
  { say: "yes", call: ["arm_run_sequence", "done"], pauseS: 22, until: untilSequenceRan },
  { say: "lights blue", call: ["set_light", "done"], pauseS: 8, until: untilBlue },
  { say: "what is the battery", call: ["query_state", "done"], pauseS: 8, until: untilCharged },
  { say: "stop", pauseS: 15, until: untilStopped },
];
const WITH_MODEL: readonly Step[] = [{ say: "drive a little", call: ["drive", "done"], pauseS: 12, until: untilDriven }, ...AFTER_DRIVE];
/** The grammar asks how far "a little" is. */
const OFFLINE: readonly Step[] = [
  { say: "drive a little", until: untilAskedAgain },
  { say: "go forward at point two metres per second for one second", call: ["drive", "done"], until: untilDriven },
  ...AFTER_DRIVE,
];
/** Words per minute: what was not understood is said again at another rate. */
const RATES = [145, 160, 135];

/** Writes down what the tab shows, as it comes. */
class Minutes {
  private readonly lines: string[] = [];
  private entries = 0;
  private calls = 0;

  constructor(
    private readonly page: Page,
    private readonly begunMs: number,
  ) {}

  async note(said: string, atS: number): Promise<void> {
    const time = `${Math.floor(atS / 60)}:${String(Math.floor(atS % 60)).padStart(2, "0")}`;
    const entries = await this.rows(transcript(this.page));
    const calls = (await this.rows(tools(this.page))).toReversed();
    const latency = this.page.getByTestId("voice-latency");
    const times = (await latency.count()) === 0 ? [] : [`     latency: ${(await latency.innerText()).replaceAll(/\s+/g, " ")}`];
    this.lines.push(`${time} microphone: ${said}`, ...times, ...entries.slice(this.entries).map((row) => `     ${row}`), ...calls.slice(this.calls).map((row) => `     tool: ${row}`));
    [this.entries, this.calls] = [entries.length, calls.length];
  }

  get nowS(): number {
    return (Date.now() - this.begunMs) / 1000;
  }

  get text(): string {
    return `${this.lines.join("\n")}\n`;
  }

  /** The rows of a list, each on one line. */
  private async rows(list: ReturnType<typeof transcript>): Promise<string[]> {
    return (await list.locator("li").allInnerTexts()).map((row) => row.trim().replace("\n", ": ").replaceAll(/\s*\n\s*/g, "; "));
  }
}

/** Reset the fault of the run's first mission: before that the strip is red, whatever color was asked for. */
async function resetFault(page: Page): Promise<void> {
  await page.locator("#tab-map").click();
  await expect(sentence(page)).toContainText(/Mission|Ready/);
  if ((await sentence(page).innerText()).includes("Mission ended by a fault")) await page.getByRole("button", { name: "Reset the fault" }).click();
  await expect(sentence(page)).toContainText(/Ready for a mission|Mission done/);
  await page.locator("#tab-voice").click();
}

/** Give the page a microphone of which `playSentence` is what it hears. */
async function replaceMicrophone(page: Page): Promise<void> {
  await page.addInitScript(() => {
    const context = new AudioContext();
    const microphone = context.createMediaStreamDestination();
    navigator.mediaDevices.getUserMedia = async () => {
      await context.resume();
      return microphone.stream;
    };
    const playSentence = async (wav: string) => {
      const source = context.createBufferSource();
      source.buffer = await context.decodeAudioData(Uint8Array.from(atob(wav), (letter) => letter.charCodeAt(0)).buffer);
      source.connect(microphone);
      source.start();
      await new Promise((resolve) => source.addEventListener("ended", resolve));
    };
    Object.assign(window, { playSentence });
  });
}

async function type(page: Page, text: string): Promise<void> {
  await page.getByLabel("Type to the agent").fill(text);
  await page.getByRole("button", { name: "Send" }).click();
}

/** Whatever other specs did, have another color than that of a robot at rest, and go to where the robot began, by typed sentences. */
async function begin(page: Page): Promise<void> {
  await type(page, "lights white");
  await expect.poll(() => truth().led_color, { message: "the strip is white" }).toEqual([255, 255, 255]);
  if (distanceM(world().start) < NEAR_M) return;
  await type(page, "go to home");
  await page.getByRole("button", { name: "Confirm" }).click();
  await untilNear(world().start, 1000 * LEAD_S);
}

async function saveTag(page: Page): Promise<void> {
  const { start, tags } = world();
  const tag = tags.find(({ id }) => id === TAG);
  if (tag === undefined) throw new Error(`the world has no tag ${TAG}`);
  const pose = { x: BEFORE_TAG.x - start.x, y: BEFORE_TAG.y - start.y, yaw: Math.atan2(tag.y - BEFORE_TAG.y, tag.x - BEFORE_TAG.x) };
  const status = await page.evaluate(async (body) => (await fetch("/_api/locations", { method: "POST", headers: { "Content-Type": "application/json" }, body })).status, JSON.stringify({ name: `tag ${TAG}`, pose }));
  expect(status).toBe(200);
}

/** How the sentence of a step is said; returns once it was said. `attempt` counts from 0. */
type Speak = (step: Step, index: number, attempt: number, minutes: Minutes) => Promise<void>;

/** Wait for the sentences of a file. */
function fromFile(page: Page, spoken: readonly Spoken[]): Speak {
  return async ({ say }, index, attempt, minutes) => {
    const { beginS = 0, endS = 0 } = spoken[index] ?? {};
    expect([attempt, minutes.nowS < beginS], `"${say}" is said once, and after what was said before it is done`).toEqual([0, true]);
    await page.waitForTimeout(1000 * (endS - minutes.nowS));
  };
}

/** Say a sentence once the agent is silent: what is said while it speaks is no turn. */
function atOnce(page: Page): Speak {
  return async ({ say }, _index, attempt) => {
    await expect(page.getByTestId("voice-state")).toHaveAttribute("data-state", "listening");
    await page.evaluate((wav) => (window as unknown as { playSentence: (wav: string) => Promise<void> }).playSentence(wav), speakWav(say, RATES[attempt]).toString("base64"));
  };
}

/** Wait for the call of a step. What may have been misheard is asked first, and takes a yes. */
async function untilUnderstood(page: Page, { call }: Step, calls: number, sayYes: () => Promise<void>): Promise<void> {
  if (call === undefined) return;
  const rows = tools(page).locator("li");
  await expect.poll(() => rows.count(), { message: "a call", timeout: 15_000 }).toBeGreaterThan(calls);
  const [tool, state] = call;
  await expect(rows.first()).toContainText(tool);
  if (state === "done" && (await rows.first().innerText()).includes("asks you")) await sayYes();
  await expect(rows.first()).toContainText(state);
}

async function take(page: Page, steps: readonly Step[], speak: Speak, attempts: number, info: TestInfo): Promise<void> {
  await page.getByRole("radio", { name: "Open microphone" }).click();
  await page.getByRole("button", { name: "Start", exact: true }).click();
  await expect(page.getByTestId("voice-stops")).toBeVisible();
  const minutes = new Minutes(page, Date.now());
  try {
    await begin(page);
    await expect(page.getByTestId("voice-stops")).toHaveAttribute("data-state", "ready");
    await minutes.note("(typed)", 0);
    for (const [index, step] of steps.entries()) {
      for (let attempt = 0; ; attempt += 1) {
        const [entries, calls] = [await transcript(page).locator("li").count(), await tools(page).locator("li").count()];
        await speak(step, index, attempt, minutes);
        const saidS = minutes.nowS;
        try {
          await untilUnderstood(page, step, calls, () => speak({ ...step, say: "yes" }, index, attempt, minutes));
        } catch (error) {
          if (attempt + 1 >= attempts) throw error;
          await minutes.note(`${step.say} (not understood)`, saidS);
          continue;
        }
        await step.until(page, entries);
        // The answer comes after the effect.
        await page.waitForTimeout(3000);
        await minutes.note(step.say, saidS);
        break;
      }
      await page.screenshot({ path: info.outputPath(`${index + 1}-${step.say.replaceAll(" ", "-")}.png`) });
    }
  } finally {
    await minutes.note("(end)", minutes.nowS);
    writeFileSync(info.outputPath("transcript.txt"), minutes.text);
  }
}

for (const engine of ["model", "offline"] as const) {
  test(`a spoken tour has its effects in the simulator: ${engine}`, async () => {
    const info = test.info();
    test.skip(!canSpeak(), "needs espeak-ng: apt-get install espeak-ng");
    test.setTimeout(480_000);
    const isModel = engine === "model";
    const steps = isModel ? WITH_MODEL : OFFLINE;
    const file = info.outputPath("speech.wav");
    const spoken = writeSentences(file, LEAD_S, WITH_MODEL.map(({ say, pauseS = 0 }) => ({ text: say, pauseS })));
    await willHear(steps.map(({ say, heard }) => heard ?? say));
    let browser: Browser | null = null;
    try {
      browser = await chromium.launch({
        executablePath: process.env["LUPIN_CHROMIUM"] ?? "/usr/bin/chromium",
        args: ["--no-sandbox", "--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream", `--use-file-for-fake-audio-capture=${file}%noloop`],
      });
      const page = await browser.newPage({ viewport: { width: 1440, height: 900 } });
      if (!isModel) await replaceMicrophone(page);
      const errors = await openLive(page, "voice");
      await takeControl(page);
      await resetFault(page);
      await saveTag(page);
      await page.getByRole("combobox", { name: "Voice agent" }).selectOption(isModel ? "auto" : "offline");
      await take(page, steps, isModel ? fromFile(page, spoken) : atOnce(page), isModel ? 1 : RATES.length, info);
      expect(errors).toEqual([]);
    } finally {
      await browser?.close();
    }
  });
}
