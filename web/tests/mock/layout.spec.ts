import { expect, test } from "@playwright/test";
import { expectReadable, expectTabsReadable, openIn } from "../support/language";
import { TABS, openMock } from "../support/page";

for (const width of [390, 768, 1440, 1920]) {
  test(`nothing reaches past the window at ${width} px, and the stop is on it`, async ({ page }) => {
    await page.setViewportSize({ width, height: width < 768 ? 844 : 1000 });
    await openMock(page, "teleop", "state=mission");
    for (const tab of TABS) {
      await page.locator(`#tab-${tab}`).click();
      await page.waitForTimeout(500);
      const overflow = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
      expect([tab, overflow]).toEqual([tab, 0]);
      const stop = await page.getByTestId("stop").boundingBox();
      expect(stop).not.toBeNull();
      expect((stop?.x ?? 0) + (stop?.width ?? 0)).toBeLessThanOrEqual(width);
      expect(Math.min(stop?.width ?? 0, stop?.height ?? 0)).toBeGreaterThanOrEqual(64);
    }
  });
}

test("touch targets are at least 44 px high on a phone", async ({ page }) => {
  await page.setViewportSize({ width: 390, height: 844 });
  await openMock(page, "teleop", "state=calm");
  for (const tab of TABS) {
    await page.locator(`#tab-${tab}`).click();
    await page.waitForTimeout(500);
    const small = await page.evaluate(() =>
      [...document.querySelectorAll("button:not([disabled])")]
        .filter((button) => button.checkVisibility())
        .map((button) => ({ name: button.getAttribute("aria-label") ?? button.textContent, box: button.getBoundingClientRect() }))
        .filter(({ box }) => box.height > 0 && box.height < 43.5)
        .map(({ name, box }) => `${name}: ${box.height}`),
    );
    expect([tab, small]).toEqual([tab, []]);
  }
});

for (const width of [390, 768, 1024, 1440, 1920]) {
  test(`both sticks lie whole on the front camera at ${width} px`, async ({ page }) => {
    await page.setViewportSize({ width, height: width < 768 ? 844 : 1000 });
    await openMock(page, "teleop", "state=calm");
    const camera = await page.getByRole("region", { name: "Front camera" }).boundingBox();
    const [move, turn] = [await page.getByRole("application", { name: "Move" }).boundingBox(), await page.getByRole("application", { name: "Turn" }).boundingBox()];
    if (camera === null || move === null || turn === null) throw new Error("not on the page");
    for (const stick of [move, turn]) {
      expect(stick.x).toBeGreaterThanOrEqual(camera.x);
      expect(stick.x + stick.width).toBeLessThanOrEqual(camera.x + camera.width);
      expect(stick.y).toBeGreaterThanOrEqual(camera.y);
      expect(stick.y + stick.height).toBeLessThanOrEqual(camera.y + camera.height);
      expect(stick.width).toBeGreaterThanOrEqual(140);
    }
    expect(move.x + move.width).toBeLessThanOrEqual(turn.x);
  });
}

test("both languages have every tab", async ({ page }) => {
  await openMock(page, "map", "state=calm");
  await page.getByRole("button", { name: "Settings" }).click();
  await page.getByText("Nederlands").click();
  await page.keyboard.press("Escape");
  await expect(page.locator("#tab-map:visible")).toContainText("Kaart");
});

// Every tab and dialog, in both languages: language.spec.ts.
test("a stopped phone in Dutch shows no English text, and none that is cut off", async ({ page }) => {
  await page.setViewportSize({ width: 390, height: 844 });
  await openIn(page, "nl", "telemetry", "state=stopped");
  await expect(page.getByTestId("stop")).toContainText("Gestopt");
  await expectReadable(page, "nl", "telemetry");
});

for (const width of [390, 768]) {
  for (const language of ["en", "nl"] as const) {
    test(`three stops at once are readable on every tab at ${width} px in ${language}`, async ({ page }) => {
      await page.setViewportSize({ width, height: 844 });
      await openIn(page, language, "voice", "state=stopped&fault=button,agent");
      const agent = { en: "voice agent of phone-2", nl: "spraakassistent van phone-2" }[language];
      await expect(page.locator("footer")).toContainText(agent);
      await expect(page.getByRole("status").filter({ has: page.getByTestId("release") })).toContainText(agent);
      await expectTabsReadable(page, language);
    });
  }
}

for (const width of [390, 768, 900, 1023, 1024, 1280]) {
  test(`the sentence of the top bar is whole at ${width} px`, async ({ page }) => {
    await page.setViewportSize({ width, height: 900 });
    await openMock(page, "map", "state=mission&control=you");
    const sentence = page.getByTestId("sentence");
    await expect(sentence).toContainText("tag");
    const cut = await sentence.evaluate((element) => [element.scrollWidth - element.clientWidth, element.scrollHeight - element.clientHeight]);
    expect(Math.max(...cut)).toBeLessThanOrEqual(1);
    const bar = await page.locator("header").first().evaluate((element) => element.scrollWidth - element.clientWidth);
    expect(bar).toBeLessThanOrEqual(0);
  });
}

for (const width of [390, 1024, 1440]) {
  test(`a message covers neither the mission nor the stop at ${width} px`, async ({ page }) => {
    await page.setViewportSize({ width, height: 900 });
    await openMock(page, "map", "state=mission&control=phone");
    await page.getByRole("tab", { name: "Places" }).click();
    await page.getByPlaceholder("Name of the map").fill("spring");
    await page.getByRole("button", { name: "Save map" }).click();
    const message = page.locator("ol[aria-live=polite] li").first();
    await expect(message).toBeVisible();
    const shown = await message.boundingBox();
    // On a phone, the panels are scrolled below it.
    const mission = width < 768 ? [] : [page.getByRole("region", { name: "Mission", exact: true })];
    for (const other of [...mission, page.getByTestId("stop")]) {
      const box = await other.boundingBox();
      if (shown === null || box === null) throw new Error("not on the page");
      const apart = shown.x + shown.width <= box.x || box.x + box.width <= shown.x || shown.y + shown.height <= box.y || box.y + box.height <= shown.y;
      expect(apart).toBe(true);
    }
  });
}

test("a phone shows whether one can drive, the link, and who has control by name", async ({ page }) => {
  await page.setViewportSize({ width: 390, height: 844 });
  await openMock(page, "map", "state=mission&control=phone");
  await expect(page.getByRole("button", { name: "Can I drive?" })).toContainText("phone-2 has control");
  await expect(page.getByTestId("link-state")).toContainText("ms");
  await expect(page.getByTestId("control-short")).toHaveText("phone-2");
  await openMock(page, "map", "state=lost&control=you");
  await page.reload();
  await expect(page.getByTestId("control-short")).toHaveText("You");
  await expect(page.getByTestId("link-state")).toContainText("no link");
});
