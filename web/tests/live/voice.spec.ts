import { tmpdir } from "node:os";
import path from "node:path";
import { type Page, expect, test } from "@playwright/test";
import { openLive, takeControl, untilAtRest, untilMoving } from "../support/live";
import { hold } from "../support/page";
import { writeSpeech } from "../support/speech_wav";

const SPEECH = path.join(tmpdir(), `lupin-speech-${process.pid}.wav`);
writeSpeech(SPEECH, 1.6, 2.4);

// The browser's microphone plays a file. The voice service is the server of tools/live_specs.py, which has sentences for what it hears.
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

const tools = (page: Page) => page.getByRole("region", { name: "Tools that were called" });
const transcript = (page: Page) => page.getByRole("region", { name: "What was said" });

test("the robot is asked, driven and stopped by voice", async ({ page }) => {
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
  const errors = await openLive(page, "voice");
  await page.getByRole("radio", { name: "Open microphone" }).click();
  await page.getByRole("button", { name: "Start", exact: true }).click();
  await untilState(page, "hearing");
  await expect(transcript(page)).toContainText("I did not understand that.");
  expect(errors).toEqual([]);
});
