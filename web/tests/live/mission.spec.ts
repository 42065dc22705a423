import { expect, test } from "@playwright/test";
import { drive, openLive, sentence, staysAtRest, takeControl, untilAtRest, untilMoving } from "../support/live";
import { hold, holdButton } from "../support/page";

test("a person resets a fault, drives by hand, runs a mission to its end, and inspects", async ({ page }) => {
  const errors = await openLive(page, "map");
  const says = sentence(page);
  const stop = page.getByTestId("stop");
  const pause = page.getByRole("button", { name: "Pause", exact: true });
  const resume = page.getByRole("button", { name: "Resume", exact: true });

  await takeControl(page);
  await expect(says).toContainText("Mission ended by a fault");
  await page.getByRole("button", { name: "Reset the fault" }).click();
  await expect(says).toContainText("Ready for a mission");

  await page.locator("#tab-teleop").click();
  await drive(page, "KeyQ");
  await expect(says).toContainText("Driving by hand");
  await page.keyboard.up("KeyQ");
  await untilAtRest();

  await page.locator("#tab-map").click();
  await page.getByLabel("Tags to find").fill("1");
  await page.getByTestId("start-mission").click();
  await expect(pause).toBeVisible();
  await untilMoving();
  await pause.click();
  await expect(says).toContainText("Mission paused");
  await untilAtRest();
  await resume.click();
  await expect(pause).toBeVisible();
  await untilMoving();

  await page.keyboard.press("Space");
  await expect(stop).toContainText("Stopped");
  await untilAtRest();
  await hold(page, "release");
  await expect(stop).not.toContainText("Stopped");
  // A release moves nothing: the mission waits for a new command.
  await expect(says).toContainText("Mission paused");
  await staysAtRest(page);
  await resume.click();
  await expect(pause).toBeVisible();
  await expect(says).toContainText("Mission done", { timeout: 150_000 });

  // An inspection of all known tags is aborted; one of a tag, twice, is skipped once.
  const skip = page.getByRole("button", { name: /^Hold to skip tag \d/ });
  await page.getByText("Inspect tags").click();
  await page.getByTestId("start-mission").click();
  const tag = /\d+/.exec((await skip.textContent()) ?? "")?.[0] ?? "";
  await holdButton(page, page.getByRole("button", { name: "Hold to abort" }));
  await expect(says).toContainText("Mission done", { timeout: 150_000 });
  await page.getByText("Inspect tags").click();
  await page.getByLabel("Tags to inspect").fill(`${tag}, ${tag}`);
  await page.getByTestId("start-mission").click();
  await holdButton(page, skip);
  await expect(page.getByText("1 skipped", { exact: false }).first()).toBeVisible();
  await expect(says).toContainText("Mission done", { timeout: 150_000 });
  expect(errors).toEqual([]);
});
