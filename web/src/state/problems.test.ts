// @vitest-environment jsdom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { MAX_MESSAGES, removeMessage, showDone, showProblem, useMessages } from "./problems";

const texts = () => useMessages.getState().messages.map(({ text, count }) => `${text} ${count}`);

beforeEach(() => {
  vi.useFakeTimers();
  useMessages.setState({ messages: [] });
});
afterEach(() => vi.useRealTimers());

describe("messages", () => {
  it("go by themselves, and when they are closed", () => {
    showDone("saved");
    showProblem(new Error("phone-2 has control"));
    expect(useMessages.getState().messages.map(({ tone }) => tone)).toEqual(["done", "problem"]);
    expect(texts()[1]).toContain("phone-2 has control");
    removeMessage(useMessages.getState().messages[0]?.number ?? -1);
    expect(texts()).toHaveLength(1);
    vi.advanceTimersByTime(7000);
    expect(texts()).toEqual([]);
  });

  it("are counted and not repeated", () => {
    for (let time = 0; time < 5; time += 1) showDone("sent");
    expect(texts()).toEqual(["sent 5"]);
    vi.advanceTimersByTime(4000);
    showDone("sent");
    vi.advanceTimersByTime(4000);
    expect(texts()).toEqual(["sent 6"]);
  });

  it("never fill the page", () => {
    for (let index = 0; index < 10; index += 1) showDone(`message ${index}`);
    expect(texts()).toHaveLength(MAX_MESSAGES);
    expect(texts().at(-1)).toBe("message 9 1");
    showDone("x".repeat(5000));
    expect(texts().at(-1)?.length).toBeLessThan(400);
  });
});
