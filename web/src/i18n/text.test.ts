// @vitest-environment jsdom
import { beforeAll, describe, expect, it } from "vitest";
import { loadDutch, setLanguage, TEXT_KEYS, textIn, useLanguage } from "./text";

beforeAll(loadDutch);

describe("texts", () => {
  it("have the same places for values in both languages", () => {
    const places = (text: string) => [...text.matchAll(/\{(\w+)\}/g)].map((match) => match[1]).toSorted();
    for (const key of TEXT_KEYS) expect([key, places(textIn("nl", key))]).toEqual([key, places(textIn("en", key))]);
  });

  it("have a word for one and for many", () => {
    expect([0, 1, 2].map((count) => textIn("en", "alarms", { count }))).toEqual(["0 alarms", "1 alarm", "2 alarms"]);
    expect([1, 2].map((count) => textIn("nl", "alarms", { count }))).toEqual(["1 alarm", "2 alarmen"]);
  });

  it("take values as they are", () => {
    expect(textIn("en", "driving_to", { tag: "<b>$&{tag}" })).toBe("Driving to tag <b>$&{tag}");
  });

  it("stay in the language that was chosen last", async () => {
    const earlier = setLanguage("nl");
    await setLanguage("en");
    await earlier;
    expect(useLanguage.getState().language).toBe("en");
  });
});
