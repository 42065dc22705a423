// @vitest-environment jsdom
import { afterEach, expect, it, vi } from "vitest";
import { useConsole } from "./console_store";
import { followServer } from "./events";

afterEach(() => vi.unstubAllGlobals());

const answerWith = (page: string) => {
  const body = JSON.stringify({ session: null, control: { holder: null, since_s: null, requester: null }, stop: [], page });
  vi.stubGlobal("fetch", () => Promise.resolve(new Response(body, { headers: { "Content-Type": "application/json" } })));
  return followServer("ws://localhost/_api/events");
};

it("a page is outdated once the server has another version", async () => {
  await answerWith("a");
  expect(useConsole.getState()).toMatchObject({ pageVersion: "a", isOutdated: false });
  await answerWith("a");
  expect(useConsole.getState().isOutdated).toBe(false);
  await answerWith("");
  expect(useConsole.getState().isOutdated).toBe(false);
  await answerWith("b");
  expect(useConsole.getState().isOutdated).toBe(true);
});
