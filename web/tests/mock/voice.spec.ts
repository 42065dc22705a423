import { type Page, expect, test } from "@playwright/test";
import { expectReadable, openIn } from "../support/language";
import { hold, openMock } from "../support/page";

/** Wait for a state of the voice agent. */
async function untilState(page: Page, state: string): Promise<void> {
  await expect(page.getByTestId("voice-state")).toHaveAttribute("data-state", state);
}

async function openVoice(page: Page, voice: string, query = "state=calm&control=you"): Promise<string[]> {
  return openMock(page, "voice", `${query}&voice=${voice}`);
}

async function start(page: Page): Promise<void> {
  await page.getByRole("button", { name: "Start the script" }).click();
  await expect(page.getByTestId("talk")).toBeEnabled();
}

async function say(page: Page, text: string): Promise<void> {
  await page.getByLabel("Type to the agent").fill(text);
  await page.getByRole("button", { name: "Send" }).click();
}

const tools = (page: Page) => page.getByRole("region", { name: "Tools that were called" });
const transcript = (page: Page) => page.getByRole("region", { name: "What was said" });

test("a turn by the button is heard, thought about and answered", async ({ page }) => {
  const errors = await openVoice(page, "state");
  await expect(page.getByTestId("voice-script")).toContainText("A script answers, and the robot is a mock");
  await untilState(page, "scripted_only");
  await hold(page, "release");
  await start(page);
  await untilState(page, "listening");
  await page.getByTestId("talk").hover();
  await page.mouse.down();
  await untilState(page, "hearing");
  await page.mouse.up();
  await untilState(page, "thinking");
  await untilState(page, "speaking");
  await untilState(page, "listening");
  await expect(transcript(page)).toContainText("The battery is at 78 percent");
  await expect(tools(page)).toContainText("query_state");
  await expect(page.getByTestId("voice-latency")).toContainText(/0\.\d\d\s*s/);
  expect(errors).toEqual([]);
});

test("a stop silences the agent, and the conversation goes on", async ({ page }) => {
  const errors = await openVoice(page, "state");
  await hold(page, "release");
  await start(page);
  await say(page, "how are you?");
  await untilState(page, "speaking");
  await page.getByTestId("talk").focus();
  await page.keyboard.press("Space");
  await untilState(page, "stopped");
  await say(page, "are you stopped?");
  await expect(transcript(page)).toContainText("I am stopped. You release the stop, I cannot.");
  expect(errors).toEqual([]);
});

test("a drive is read back, and carried out by the button", async ({ page }) => {
  const errors = await openVoice(page, "confirm");
  await hold(page, "release");
  await start(page);
  await say(page, "go home");
  await expect(page.getByTestId("voice-confirm")).toContainText("navigate to the location home");
  await expect(page.getByTestId("voice-confirm")).toContainText(/\d+ s left/);
  await page.getByRole("button", { name: "Confirm" }).click();
  await expect(page.getByTestId("voice-confirm")).toHaveCount(0);
  await expect(tools(page)).toContainText("by your button");
  await expect(tools(page)).toContainText("action goto, name home");
  expect(errors).toEqual([]);
});

test("what was read back is forgotten by the other button", async ({ page }) => {
  const errors = await openVoice(page, "confirm");
  await hold(page, "release");
  await start(page);
  await say(page, "go home");
  await page.getByRole("button", { name: "Cancel" }).click();
  await expect(page.getByTestId("voice-confirm")).toHaveCount(0);
  await expect(tools(page)).not.toContainText("by your button");
  expect(errors).toEqual([]);
});

test("a page that cannot drive yet refuses what moves the robot, and says why", async ({ page }) => {
  await openVoice(page, "refused");
  await start(page);
  await untilState(page, "listening");
  await expect(page.getByTestId("voice-state")).toContainText("This page cannot drive yet");
  await say(page, "drive");
  await expect(tools(page)).toContainText("refused");
  await expect(tools(page)).toContainText("the operator must hold its release button first");
});

test("an agent that calls again and again is refused for the turn", async ({ page }) => {
  await openVoice(page, "loop");
  await hold(page, "release");
  await start(page);
  await say(page, "again");
  await untilState(page, "refused");
  await expect(page.getByTestId("voice-state")).toContainText("it called query_state with the same arguments again and again");
});

test("a session that ends says what to do", async ({ page }) => {
  await openVoice(page, "quota");
  await start(page);
  await say(page, "hello");
  await untilState(page, "failed");
  await expect(page.getByTestId("voice-state")).toContainText("The quota of the key is used up");
  await expect(page.getByRole("button", { name: "Start the script" })).toBeVisible();
});

test("a service that is away is named", async ({ page }) => {
  await openVoice(page, "offline");
  await page.getByRole("button", { name: "Start the script" }).click();
  await untilState(page, "connecting");
  await untilState(page, "failed");
  await expect(page.getByTestId("voice-state")).toContainText("The voice service cannot be reached");
});

test("a conversation goes on over another connection", async ({ page }) => {
  const errors = await openVoice(page, "away");
  await hold(page, "release");
  await start(page);
  for (const text of ["one", "two"]) {
    await say(page, text);
    await untilState(page, "speaking");
    await untilState(page, "listening");
  }
  await expect(transcript(page).getByText("Nothing stops me.")).toHaveCount(2);
  expect(errors).toEqual([]);
});

test("a page without its console carries out nothing", async ({ page }) => {
  await openVoice(page, "state", "state=lost&control=you");
  await start(page);
  await untilState(page, "link_lost");
  await expect(page.getByTestId("talk")).toBeDisabled();
  await expect(page.getByRole("button", { name: "Send" })).toBeDisabled();
});

test("a conversation ends with its tab", async ({ page }) => {
  const errors = await openVoice(page, "state");
  await start(page);
  await page.locator("#tab-map").click();
  await page.locator("#tab-voice").click();
  await untilState(page, "scripted_only");
  expect(errors).toEqual([]);
});

const WORDS = {
  en: { startScript: "Start the script", type: "Type to the agent", send: "Send", asks: "navigate to the location home" },
  nl: { startScript: "Script starten", type: "Typ aan de assistent", send: "Verzenden", asks: "rijden naar de plaats home" },
};

for (const width of [390, 1440]) {
  for (const language of ["en", "nl"] as const) {
    test(`every state is readable at ${width} px in ${language}`, async ({ page }) => {
      test.slow();
      const words = WORDS[language];
      await page.setViewportSize({ width, height: width === 390 ? 844 : 900 });

      async function open(query: string): Promise<void> {
        await openIn(page, language, "voice", query);
        // Another part of the address alone loads nothing.
        await page.reload();
        await expect(page.getByTestId("voice-state")).toBeVisible();
      }
      async function begin(): Promise<void> {
        await page.getByRole("button", { name: words.startScript }).click();
      }
      async function type(text: string): Promise<void> {
        await page.getByLabel(words.type).fill(text);
        await page.getByRole("button", { name: words.send }).click();
      }
      /** Look at a state: no text is cut off or foreign, and nothing reaches past the window. */
      async function look(state: string, name = state): Promise<void> {
        await untilState(page, state);
        await expectReadable(page, language, name);
        expect.soft([name, await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth)]).toEqual([name, 0]);
        await page.screenshot({ path: test.info().outputPath(`${name}.png`), fullPage: true });
      }

      await open("state=calm&control=you&voice=confirm");
      await look("scripted_only");
      await begin();
      await look("listening", "not released");
      await hold(page, "release");
      await expect(page.getByTestId("release")).toHaveCount(0);
      await look("listening");
      await page.getByTestId("talk").hover();
      await page.mouse.down();
      await look("hearing");
      await page.mouse.up();
      await expect(page.getByTestId("voice-confirm")).toContainText(words.asks);
      await look("listening", "asks");

      await open("state=calm&control=you&voice=state");
      await hold(page, "release");
      await begin();
      await type("hallo");
      await look("speaking");
      await page.getByTestId("talk").focus();
      await page.keyboard.press("Space");
      await look("stopped");

      for (const [voice, state] of [["refused", "listening"], ["loop", "refused"], ["quota", "failed"], ["offline", "failed"]] as const) {
        await open(`state=calm&control=you&voice=${voice}`);
        await begin();
        if (voice !== "offline") await type("hallo");
        if (voice === "refused") await expect(page.getByText("drive", { exact: true })).toBeVisible();
        await look(state, `${voice}, ${state}`);
      }

      await open("state=lost&control=you&voice=state");
      await look("link_lost");
    });
  }
}
