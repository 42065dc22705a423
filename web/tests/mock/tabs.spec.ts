import { expect, test } from "@playwright/test";
import { hold, openMock } from "../support/page";

test("of two tabs of a browser one commands, and the other can stop and take over", async ({ context }) => {
  const first = await context.newPage();
  await openMock(first, "teleop", "state=calm&control=you");
  await hold(first, "release");
  await expect(first.getByText("Sticks are live")).toBeVisible();

  const second = await context.newPage();
  await openMock(second, "teleop", "state=calm&control=you");
  await expect(second.getByTestId("other-tab")).toContainText("Another tab of this browser has control");
  await expect(second.getByText("Sticks are blocked")).toBeVisible();
  await expect(second.getByTestId("release")).toBeDisabled();
  await expect(first.getByTestId("other-tab")).toHaveCount(0);
  await second.keyboard.press("Space");
  await expect(second.getByTestId("stop")).toContainText("Stopped");

  await second.getByRole("button", { name: "Take over in this tab" }).click();
  await expect(second.getByTestId("other-tab")).toHaveCount(0);
  await expect(first.getByTestId("other-tab")).toBeVisible();
  await expect(first.getByText("Sticks are blocked")).toBeVisible();
  await hold(second, "release");
  await expect(second.getByText("Sticks are live")).toBeVisible();

  await second.close();
  await expect(first.getByTestId("other-tab")).toHaveCount(0);
  await expect(first.getByText("Sticks are blocked")).toBeVisible();
});
