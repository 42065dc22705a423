import { type Page, expect, test } from "@playwright/test";
import { openMock } from "../support/page";

async function openPlaces(page: Page): Promise<string[]> {
  const errors = await openMock(page, "map", "state=calm&control=you");
  await page.getByRole("tab", { name: "Places" }).click();
  return errors;
}

/** Hold a button until a message tells what came of it. */
async function holdNamed(page: Page, name: string, message: string): Promise<void> {
  await page.getByRole("button", { name }).hover();
  await page.mouse.down();
  await expect(page.getByText(message)).toBeVisible();
  await page.mouse.up();
}

/** Draw a pose on the map by a drag. */
async function drawPose(page: Page): Promise<void> {
  const box = await page.getByTestId("map-canvas").boundingBox();
  if (box === null) throw new Error("the map has no place");
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 60, y - 30, { steps: 4 });
  await page.mouse.up();
}

test("a map is saved, chosen, loaded and deleted", async ({ page }) => {
  const errors = await openPlaces(page);
  await page.getByPlaceholder("Name of the map").fill("spring");
  await page.getByRole("button", { name: "Save map" }).click();
  await expect(page.getByText("Map spring saved")).toBeVisible();
  await expect(page.getByText("lupin up --map '/home/grower/.local/state/lupin/maps/spring.yaml'")).toBeVisible();
  await page.getByPlaceholder("Name of the map").fill("spring");
  await expect(page.getByRole("button", { name: "Save map" })).toHaveCount(0);
  await page.getByRole("button", { name: "Hold to replace" }).hover();
  await page.mouse.down();
  await expect(page.getByRole("button", { name: "Save map" })).toBeVisible();
  await page.mouse.up();
  await holdNamed(page, "Hold to load the map spring", "The robot now uses the map spring");
  await expect(page.getByText("It cannot be deleted now: it is the loaded map.")).toBeVisible();
  await expect(page.getByRole("button", { name: "Hold to delete the map spring" })).toBeDisabled();
  await page.getByRole("button", { name: "hall", exact: true }).click();
  await holdNamed(page, "Hold to delete the map hall", "Map hall deleted");
  await expect(page.getByRole("button", { name: "hall", exact: true })).toHaveCount(0);
  expect(errors).toEqual([]);
});

test("no map is loaded during a mission, and the page says why", async ({ page }) => {
  await openMock(page, "map", "state=mission&control=you");
  await page.getByRole("tab", { name: "Places" }).click();
  await page.getByRole("button", { name: "hall", exact: true }).click();
  await expect(page.getByText("It cannot be loaded now: a mission is running.")).toBeVisible();
  await expect(page.getByRole("button", { name: "Hold to load the map hall" })).toBeDisabled();
});

test("the robot is relocated by a drawn pose", async ({ page }) => {
  const errors = await openPlaces(page);
  await page.getByRole("tabpanel", { name: "Places" }).getByRole("button", { name: "Correct the position" }).click();
  await drawPose(page);
  await page.getByRole("button", { name: "It is here" }).click();
  await expect(page.getByText("The robot's position was corrected")).toBeVisible();
  expect(errors).toEqual([]);
});

test("a drawn approach is stored, and removed", async ({ page }) => {
  const errors = await openPlaces(page);
  await page.getByRole("tab", { name: "Greenhouse" }).click();
  await page.getByRole("button", { name: /^Tag 3,/ }).first().click();
  await page.getByRole("tab", { name: "Places" }).click();
  await page.getByRole("button", { name: "Draw for tag 3" }).click();
  await drawPose(page);
  await page.getByRole("button", { name: "Keep", exact: true }).click();
  await expect(page.getByText("Approach of tag 3 stored")).toBeVisible();
  await page.getByRole("button", { name: "Remove the approach of tag 3" }).click();
  await expect(page.getByRole("button", { name: "Remove the approach of tag 3" })).toBeHidden();
  expect(errors).toEqual([]);
});
