import { expect, test } from "@playwright/test";
import { openMock } from "../support/page";

test("what is out of date is not shown as of now", async ({ page }) => {
  await openMock(page, "teleop", "state=stale&control=you");
  await expect(page.getByTestId("sentence")).toContainText("The mission does not answer");
  await expect(page.getByTestId("sentence")).toContainText(" s");
  await page.getByRole("button", { name: "Can I drive?" }).click();
  await expect(page.getByRole("dialog").getByText("the drive bus does not answer", { exact: false })).toBeVisible();
  await page.keyboard.press("Escape");
  await expect(page.getByTestId("battery-age")).toContainText("ago");
  await page.keyboard.press("Control+k");
  await page.keyboard.type("mission");
  await expect(page.getByText("No command with this name")).toBeVisible();
});
