// @vitest-environment jsdom
import { afterEach, expect, it, vi } from "vitest";
import { setOnline, useConsole } from "./console_store";
import { dropChannel, followServer } from "./events";

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

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

it("the channel is lost since its last message, whatever attempts to connect do", async () => {
  vi.useFakeTimers();
  const sockets: { onopen?: () => void; onmessage?: (message: { data: string }) => void; onclose?: () => void; close: () => void }[] = [];
  vi.stubGlobal("WebSocket", function () {
    const socket = { close: () => {} };
    sockets.push(socket);
    return socket;
  });
  const json = { headers: { "Content-Type": "application/json" } };
  const session = { name: "laptop-1", role: "operator" };
  const answer = () => new Response(JSON.stringify({ session, control: { holder: null, since_s: null, requester: null }, stop: [] }), json);
  vi.stubGlobal("fetch", () => Promise.resolve(answer()));
  await followServer("ws://localhost/_api/events");
  sockets.at(-1)?.onopen?.();
  expect(useConsole.getState().online).toBe(false);
  sockets.at(-1)?.onmessage?.({ data: '{"event":"stop","value":[]}' });
  expect(useConsole.getState().online).toBe(true);
  const lostMs = performance.now();
  for (let attempt = 0; attempt < 4; attempt += 1) {
    const before = sockets.length;
    sockets.at(-1)?.onopen?.();
    sockets.at(-1)?.onclose?.();
    expect(useConsole.getState()).toMatchObject({ online: false, onlineChangedMs: lostMs });
    if (attempt === 1) vi.stubGlobal("fetch", () => Promise.reject(new Error("no server")));
    await vi.advanceTimersByTimeAsync(1500);
    if (attempt === 0) expect(sockets.length).toBe(before + 1);
    expect(useConsole.getState().onlineChangedMs).toBe(lostMs);
  }
  dropChannel();
  setOnline(true);
  expect(useConsole.getState().onlineChangedMs).toBeGreaterThan(lostMs);
});
