import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { FakeSocket } from "./fake_socket";
import { LiveClient } from "./live_client";
import { liveModel } from "./models";

beforeEach(() => vi.useFakeTimers());
afterEach(() => vi.useRealTimers());

function opened(model = "gemini-3.1-flash-live-preview") {
  const sockets: FakeSocket[] = [];
  const listener = { opened: vi.fn(), received: vi.fn(), reconnecting: vi.fn(), failed: vi.fn() };
  const open = vi.fn(async () => {
    const socket = new FakeSocket();
    sockets.push(socket);
    return socket;
  });
  const client = new LiveClient(open, liveModel(model), () => "be brief", listener);
  client.start();
  const last = () => sockets.at(-1) ?? new FakeSocket();
  const connect = async () => {
    await vi.advanceTimersByTimeAsync(0);
    last().open();
    last().deliver({ setupComplete: {} });
  };
  return { client, sockets, listener, open, last, connect };
}

const handleOf = (socket: FakeSocket) => (socket.sent[0] as { setup: { sessionResumption: { handle?: string } } }).setup.sessionResumption.handle;

describe("the client of the Live API", () => {
  it("keeps what is sent before the setup is complete", async () => {
    const { client, last, connect } = opened();
    client.beginActivity();
    client.sendAudio("AA==");
    await connect();
    expect(last().sent.slice(1)).toEqual([{ realtimeInput: { activityStart: {} } }, { realtimeInput: { audio: { data: "AA==", mimeType: "audio/pcm;rate=16000" } } }]);
  });

  it("drops the oldest audio where too much waits", async () => {
    const { client, last, connect } = opened();
    client.beginActivity();
    for (let frame = 0; frame < 300; frame += 1) client.sendAudio(String(frame));
    await connect();
    expect(last().sent).toHaveLength(201);
    expect(last().sent[1]).toEqual({ realtimeInput: { activityStart: {} } });
    expect(JSON.stringify(last().sent.at(-1))).toContain('"299"');
  });

  it("moves to another connection between two turns", async () => {
    const { client, sockets, last, connect, listener } = opened();
    await connect();
    client.setBusy(true);
    last().deliver({ sessionResumptionUpdate: { newHandle: "h1", resumable: true } });
    last().deliver({ goAway: { timeLeft: "50s" } });
    expect(sockets).toHaveLength(1);
    client.setBusy(false);
    await connect();
    expect(sockets).toHaveLength(2);
    expect(sockets[0]?.isClosed).toBe(true);
    expect(handleOf(last())).toBe("h1");
    expect(listener.opened).toHaveBeenLastCalledWith(false);
  });

  it("moves in a turn before the connection ends", async () => {
    const { client, sockets, last, connect } = opened();
    await connect();
    client.setBusy(true);
    last().deliver({ sessionResumptionUpdate: { newHandle: "h1", resumable: true } });
    last().deliver({ goAway: { timeLeft: "10s" } });
    await vi.advanceTimersByTimeAsync(7001);
    expect(sockets).toHaveLength(2);
  });

  it("goes on with an utterance on another connection", async () => {
    const { client, last, connect } = opened();
    await connect();
    client.beginActivity();
    client.sendAudio("AA==");
    last().end(1011);
    client.sendAudio("BB==");
    client.endActivity();
    await vi.advanceTimersByTimeAsync(300);
    await connect();
    const kinds = last().sent.slice(1).map((message) => Object.keys(message["realtimeInput"] as object)[0]);
    expect(kinds).toEqual(["activityStart", "audio", "activityEnd"]);
  });

  it("moves before the service ends a long connection", async () => {
    const { sockets, last, connect } = opened("gemini-3.8-live");
    await connect();
    last().deliver({ sessionResumptionUpdate: { newHandle: "h1", resumable: true } });
    await vi.advanceTimersByTimeAsync(50 * 60_000 + 1);
    expect(sockets).toHaveLength(2);
  });

  it("begins anew, and says so, where the conversation cannot go on", async () => {
    const { client, last, connect, listener } = opened();
    await connect();
    client.sendText("hello");
    last().deliver({ sessionResumptionUpdate: { newHandle: "h1", resumable: true } });
    last().end(1011, "Deadline expired before operation could complete.");
    await vi.advanceTimersByTimeAsync(300);
    last().open();
    expect(handleOf(last())).toBe("h1");
    last().end(1007, "invalid argument");
    await vi.advanceTimersByTimeAsync(1000);
    await connect();
    expect(handleOf(last())).toBeUndefined();
    expect(listener.opened).toHaveBeenLastCalledWith(true);
  });

  it("gives up after some tries, and says why", async () => {
    const { last, listener, open } = opened();
    for (let tries = 0; tries < 6; tries += 1) {
      await vi.advanceTimersByTimeAsync(5000);
      last().end(1006);
    }
    expect(open).toHaveBeenCalledTimes(5);
    expect(listener.failed).toHaveBeenCalledOnce();
    expect(listener.failed.mock.calls[0]?.[0]).toMatchObject({ phrase: { key: "voice_fail_offline" } });
  });

  it("finds a server that does not answer", async () => {
    const { last, listener, open } = opened();
    await vi.advanceTimersByTimeAsync(0);
    last().open();
    await vi.advanceTimersByTimeAsync(12_400);
    expect(open).toHaveBeenCalledTimes(2);
    expect(listener.failed).not.toHaveBeenCalled();
  });

  it("ends at what is no frame, and is silent after its end", async () => {
    const { client, last, connect, listener } = opened();
    await connect();
    last().deliver("{");
    expect(listener.failed.mock.calls[0]?.[0]).toMatchObject({ phrase: { key: "voice_fail_frame" } });
    const received = listener.received.mock.calls.length;
    last().deliver({ serverContent: { turnComplete: true } });
    client.sendText("hello");
    expect(listener.received).toHaveBeenCalledTimes(received);
  });
});
