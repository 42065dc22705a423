/** What a person reads on the page: every visible text, and the texts that are cut off or leave their box. */
import { type Page, expect } from "@playwright/test";
import { TABS, openMock } from "./page";

export type Language = "en" | "nl";

/** Open the page in a language. */
export async function openIn(page: Page, language: Language, tab: string, query: string): Promise<void> {
  await page.addInitScript((chosen) => localStorage.setItem("lupin-language", chosen), language);
  await openMock(page, tab, query);
}

/** English words that are no Dutch ones. */
const ENGLISH =
  /(?<![\w/.-])(the|and|with|without|not|this|that|you|your|from|has|have|had been|for|to|by|are|it|its|when|while|who|which|ago|stopped|holds|held|hold|released?|nothing|nobody|speed|battery|left|right|turn|lost|reading|read|driving|moving|ready|none|all|yes|no|on|off|at|as)(?![\w/-])/i;

interface Shown {
  /** Texts, labels, titles and placeholders that are not marked as of another language. */
  texts: string[];
  /** Texts that leave the box they are in, or are cut off by it. */
  overflowing: string[];
}

/** Read the page: what is marked `lang`, as what the robot wrote is, is in the language it says. */
function read(page: Page): Promise<Shown> {
  return page.evaluate(() => {
    const texts: string[] = [];
    const overflowing: string[] = [];
    const isForeign = (element: Element) => element.closest("[lang]") !== document.documentElement;
    for (const element of document.querySelectorAll("body *")) {
      if (isForeign(element) || !element.checkVisibility({ visibilityProperty: true })) continue;
      for (const name of ["aria-label", "title", "placeholder", "aria-valuetext"]) texts.push(element.getAttribute(name) ?? "");
    }
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node !== null; node = walker.nextNode()) {
      const parent = node.parentElement;
      const text = node.textContent?.trim() ?? "";
      if (parent === null || text === "" || parent.closest("script, style, svg, option, .sr-only") !== null || !parent.checkVisibility({ visibilityProperty: true })) continue;
      if (!isForeign(parent)) texts.push(text);
      const range = document.createRange();
      range.selectNodeContents(node);
      const box = range.getBoundingClientRect();
      if (box.width === 0 || box.width < 2) continue;
      for (let outer: Element | null = parent; outer !== null && outer !== document.body; outer = outer.parentElement) {
        const style = getComputedStyle(outer);
        // For screen readers only.
        if (style.position === "absolute" && outer.clientWidth <= 1) break;
        // What scrolls can be read; an ellipsis says that something is missing, and the name of a topic may be of any length.
        if (/auto|scroll/.test(style.overflowX + style.overflowY)) break;
        if (style.textOverflow === "ellipsis" && /[/_]/.test(text)) break;
        const isBox = style.overflowX !== "visible" || style.borderTopWidth !== "0px" || outer.matches("button, [role=dialog], td, th, li, header, footer");
        const area = outer.getBoundingClientRect();
        if (!isBox || style.display === "inline" || area.width === 0) continue;
        const beside = Math.max(box.right - area.right, area.left - box.left);
        // The box of a line is higher than its letters.
        const above = Math.max(box.bottom - area.bottom, area.top - box.top) - box.height / 4;
        const out = Math.max(beside, above);
        if (out > 2) {
          overflowing.push(`${text.slice(0, 60)}: ${Math.round(out)} px out of <${outer.tagName.toLowerCase()} class="${outer.className.toString().slice(0, 40)}">`);
          break;
        }
      }
    }
    return { texts, overflowing };
  });
}

/** No text of what is shown is cut off, and in Dutch none is English. */
export async function expectReadable(page: Page, language: Language, where: string): Promise<void> {
  await expect(page.locator("html")).toHaveAttribute("lang", language);
  const { texts, overflowing } = await read(page);
  const english = language === "nl" ? [...new Set(texts)].filter((text) => ENGLISH.test(text)) : [];
  expect.soft({ where, english, overflowing: [...new Set(overflowing)] }).toEqual({ where, english: [], overflowing: [] });
}

/** Look at every tab, and at the panels that share a place in it. */
export async function expectTabsReadable(page: Page, language: Language): Promise<void> {
  for (const tab of TABS) {
    await page.locator(`#tab-${tab}`).click();
    await expect(page.locator("#view").getByText(/^(Loading|Laden)$/)).toHaveCount(0);
    await page.waitForTimeout(400);
    await expectReadable(page, language, tab);
    for (const panel of await page.locator("#view").getByRole("tab").all()) {
      if (!(await panel.isVisible())) continue;
      await panel.click();
      await page.waitForTimeout(200);
      await expectReadable(page, language, `${tab}: ${await panel.innerText()}`);
    }
  }
}
