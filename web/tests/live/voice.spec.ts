import { tmpdir } from "node:os";
import path from "node:path";
import { type Page, expect, test } from "@playwright/test";
import { type Language, expectReadable } from "../support/language";
import { CONSOLE, openLive, takeControl, untilAtRest, untilMoving, willHear } from "../support/live";
import { hold } from "../support/page";
import { writeSpeech } from "../support/speech_wav";

const SPEECH = path.join(tmpdir(), `lupin-speech-${process.pid}.wav`);
writeSpeech(SPEECH, 1.6, 2.4);

// The browser's microphone plays a file. The voice service is the server of tools/live_specs.py, which is told what it hears.
test.use({
  launchOptions: {
    executablePath: process.env["LUPIN_CHROMIUM"] ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--disable-gpu", "--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream", `--use-file-for-fake-audio-capture=${SPEECH}`],
  },
});

async function untilState(page: Page, state: string): Promise<void> {
  await expect(page.getByTestId("voice-state")).toHaveAttribute("data-state", state);
}

/** Hold the button to talk for as long as a sentence takes. */
async function talk(page: Page): Promise<void> {
  await page.getByTestId("talk").hover();
  await page.mouse.down();
  await untilState(page, "hearing");
  await page.waitForTimeout(2000);
  await page.mouse.up();
}

/** Open the tab in a language, and take control; the texts by which `openLive` waits are English. */
async function openVoiceOffline(page: Page, language: Language): Promise<void> {
  await page.addInitScript(() => sessionStorage.setItem("lupin-booted", "1"));
  await page.goto(`${CONSOLE}/#voice`);
  await hold(page, "release");
  await page.getByRole("combobox", { name: language === "en" ? "Voice agent" : "Spraakassistent" }).selectOption("offline");
  await untilState(page, "off");
}

const tools = (page: Page) => page.getByRole("region", { name: "Tools that were called" });
const transcript = (page: Page) => page.getByRole("region", { name: "What was said" });

test("the robot is asked, driven and stopped by voice", async ({ page }) => {
  await willHear(["where are you", "drive a little", "drive a little"]);
  const errors = await openLive(page, "voice");
  await expect(page.getByText("Stored by the console.")).toBeVisible();
  await takeControl(page);
  await page.getByRole("button", { name: "Start", exact: true }).click();
  await untilState(page, "listening");

  await talk(page);
  await expect(transcript(page)).toContainText("where are you");
  await expect(tools(page)).toContainText("query_state");
  await expect(transcript(page)).toContainText("Done.");
  await expect(page.getByTestId("voice-latency")).toContainText(/\d\.\d\d\s*s/);

  await talk(page);
  await untilMoving();
  await untilAtRest();
  await expect(tools(page)).toContainText("drive");

  // A stop of this page: what moves is refused, and the microphone goes on.
  await page.getByTestId("stop").click();
  await untilState(page, "stopped");
  await talk(page);
  await expect(tools(page)).toContainText("the operator must hold its release button first");
  await hold(page, "release");

  await page.getByLabel("Type to the agent").fill("emergency");
  await page.getByRole("button", { name: "Send" }).click();
  await expect(page.getByTestId("stop")).toContainText("Stopped");
  expect(errors).toEqual([]);
});

test("an open microphone makes turns of what it hears", async ({ page }) => {
  await willHear([]);
  const errors = await openLive(page, "voice");
  await page.getByRole("radio", { name: "Open microphone" }).click();
  await page.getByRole("button", { name: "Start", exact: true }).click();
  await untilState(page, "hearing");
  await expect(transcript(page)).toContainText("I did not understand that.");
  expect(errors).toEqual([]);
});

for (const [width, height] of [[390, 844], [1440, 900]] as const) {
  for (const language of ["en", "nl"] as const) {
    test(`the agent without a model is readable at ${width} px in ${language}`, async ({ page }) => {
      await page.setViewportSize({ width, height });
      await page.addInitScript((chosen) => localStorage.setItem("lupin-language", chosen), language);
      await openVoiceOffline(page, language);
      await expectReadable(page, language, "before the start");
      await page.screenshot({ path: test.info().outputPath("before.png"), fullPage: true });
      await page.getByRole("button", { name: language === "en" ? "Start" : "Starten", exact: true }).click();
      await untilState(page, "listening");
      await page.getByRole("textbox").first().fill("what is the battery");
      await page.keyboard.press("Enter");
      await expect(page.getByText("query_state", { exact: true })).toBeVisible();
      await expectReadable(page, language, "after an answer");
      await page.screenshot({ path: test.info().outputPath("answered.png"), fullPage: true });
    });
  }
}
