import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Conversation, type ConversationParts } from "./conversation";
import { FakeSocket } from "./live/fake_socket";
import { liveModel } from "./live/models";
import { EMPTY_VIEW, MAX_CALLS, MAX_ENTRIES, useVoice } from "./voice_store";

type Message = Record<string, Record<string, unknown>>;

beforeEach(() => {
  vi.useFakeTimers();
  useVoice.setState(EMPTY_VIEW);
});
afterEach(() => vi.useRealTimers());

const AUDIO = { serverContent: { modelTurn: { parts: [{ inlineData: { mimeType: "audio/pcm;rate=24000", data: "AAAA" } }] } } };
const DONE = { serverContent: { turnComplete: true } };
const call = (id: string, name = "query_state", args: object = {}) => ({ toolCall: { functionCalls: [{ id, name, args }] } });

async function begun(parts: Partial<ConversationParts> = {}) {
  const [live, desk] = [new FakeSocket(), new FakeSocket()];
  const player = { play: vi.fn(), flush: vi.fn(), isPlaying: false };
  const ended = vi.fn();
  let nowMs = 0;
  const conversation = new Conversation({
    openLive: async () => live,
    model: liveModel("gemini-3.8-live"),
    instruction: () => "be brief",
    consoleUrl: "ws://console/_api/voice",
    openConsole: () => desk,
    player,
    refusal: () => null,
    inWords: ({ message }) => message,
    ended,
    now: () => nowMs,
    ...parts,
  });
  conversation.start();
  await vi.advanceTimersByTimeAsync(0);
  desk.open();
  live.open();
  live.deliver({ setupComplete: {} });
  live.sent.length = 0;
  const answer = async (id: string, response: object) => {
    desk.deliver({ result: { id, name: "any", response } });
    await vi.advanceTimersByTimeAsync(0);
  };
  return { conversation, live, desk, player, ended, answer, wait: (ms: number) => (nowMs += ms) };
}

const kinds = (socket: FakeSocket) => (socket.sent as Message[]).map((message) => Object.keys(message)[0] === "realtimeInput" ? Object.keys(message["realtimeInput"] ?? {})[0] : Object.keys(message)[0]);
const turns = (desk: FakeSocket) => (desk.sent as Message[]).flatMap(({ turn }) => (turn === undefined ? [] : [turn]));
const calls = (desk: FakeSocket) => (desk.sent as Message[]).flatMap(({ call: made }) => (made === undefined ? [] : [made]));
const view = () => useVoice.getState();

describe("a turn of the operator", () => {
  it("in speech is announced at its begin and its end", async () => {
    const { conversation, live, desk } = await begun();
    conversation.hear(new Int16Array(800));
    conversation.beginSpeech();
    conversation.hear(new Int16Array(800));
    conversation.endSpeech();
    conversation.endSpeech();
    conversation.hear(new Int16Array(800));
    expect(kinds(live)).toEqual(["activityStart", "audio", "activityEnd"]);
    expect(turns(desk)).toEqual([
      { id: turns(desk)[0]?.["id"], by: "speech", ended: false },
      { id: turns(desk)[0]?.["id"], by: "speech", ended: true },
    ]);
    expect(view()).toMatchObject({ isOperatorSpeaking: false, isThinking: true });
  });

  it("in writing is a turn of its own", async () => {
    const { conversation, live, desk } = await begun();
    conversation.say("where are you?");
    expect(kinds(live)).toEqual(["clientContent"]);
    expect(turns(desk)).toMatchObject([{ by: "text", ended: true }]);
    expect(view().transcript).toMatchObject([{ who: "operator", text: "where are you?" }]);
  });

  it("is never announced for what the model sends", async () => {
    const { live, desk } = await begun();
    live.deliver({ serverContent: { inputTranscription: { text: "go home" }, interrupted: true } });
    live.deliver(call("1"));
    expect(turns(desk)).toEqual([]);
  });

  it("is announced again to a console that was away", async () => {
    const { conversation, desk } = await begun();
    conversation.say("hello");
    desk.end(1006);
    expect(view().isConsoleOpen).toBe(false);
    await vi.advanceTimersByTimeAsync(1500);
    desk.open();
    expect(turns(desk)).toHaveLength(2);
    expect(turns(desk)[1]).toEqual(turns(desk)[0]);
  });

  it("measures the first sound and the first call", async () => {
    const { conversation, live, wait } = await begun();
    conversation.beginSpeech();
    wait(2000);
    conversation.endSpeech();
    wait(300);
    live.deliver(call("1"));
    wait(200);
    live.deliver(AUDIO);
    live.deliver(AUDIO);
    expect(view().latency).toEqual({ callMs: 300, soundMs: 500 });
  });
});

describe("a call of the model", () => {
  it("is carried out by the console, and its result goes back", async () => {
    const { conversation, live, desk, answer } = await begun();
    conversation.say("where are you?");
    live.deliver(call("1", "query_state", { fields: ["pose"] }));
    expect(calls(desk)).toEqual([{ id: "1", name: "query_state", arguments: { fields: ["pose"] } }]);
    await answer("1", { ok: true, pose: { x: 1 } });
    expect(live.sent.at(-1)).toEqual({ toolResponse: { functionResponses: [{ id: "1", name: "query_state", response: { ok: true, pose: { x: 1 } } }] } });
    expect(view().calls).toMatchObject([{ tool: "query_state", state: "done", byOperator: false }]);
  });

  it("that this page refuses is no call at the console, but stands in its journal", async () => {
    const { conversation, live, desk } = await begun({ refusal: () => ({ ok: false, blocked: true, error: "the page is stopped" }) });
    conversation.say("go");
    live.deliver(call("1", "drive", { linear_x: 0.2 }));
    await vi.advanceTimersByTimeAsync(0);
    expect(calls(desk)).toEqual([]);
    expect(desk.sent.at(-1)).toEqual({ refused: { name: "drive", arguments: { linear_x: 0.2 }, reason: "the page is stopped" } });
    expect(view().calls).toMatchObject([{ state: "refused", result: { error: "the page is stopped" } }]);
    expect(kinds(live).at(-1)).toBe("toolResponse");
  });

  it("gets no answer after many refusals in a turn", async () => {
    const { conversation, live } = await begun({ refusal: () => ({ ok: false, error: "no" }) });
    conversation.say("go");
    for (let each = 0; each < 20; each += 1) live.deliver(call(`${each}`, "drive"));
    await vi.advanceTimersByTimeAsync(0);
    expect(kinds(live).filter((kind) => kind === "toolResponse")).toHaveLength(0);
  });

  it("that the model cancels is not answered", async () => {
    const { conversation, live, answer } = await begun();
    conversation.say("go");
    live.deliver(call("1"));
    live.deliver({ toolCallCancellation: { ids: ["1"] } });
    live.sent.length = 0;
    await answer("1", { ok: true });
    expect(live.sent).toEqual([]);
  });

  it("without a console says so", async () => {
    const { conversation, live, desk } = await begun();
    conversation.say("go");
    live.deliver(call("1"));
    desk.end(1006);
    await vi.advanceTimersByTimeAsync(0);
    expect(JSON.stringify(live.sent.at(-1))).toContain("the link to the console was lost");
  });

  it("to speak writes to the transcript", async () => {
    const { conversation, live, answer } = await begun();
    conversation.say("write");
    live.deliver(call("1", "speak", { text: "Hello." }));
    await answer("1", { ok: true });
    expect(view().transcript.at(-1)).toMatchObject({ who: "note", text: "Hello." });
  });
});

describe("an interrupted answer", () => {
  it("is dropped with its calls", async () => {
    const { conversation, live, desk, player } = await begun();
    conversation.say("tell me a story");
    live.deliver(AUDIO);
    conversation.beginSpeech();
    expect(player.flush).toHaveBeenCalled();
    conversation.endSpeech();
    player.play.mockClear();
    live.deliver(AUDIO);
    live.deliver(call("late", "drive", { duration_s: 1 }));
    expect(player.play).not.toHaveBeenCalled();
    expect(calls(desk)).toEqual([]);
    live.deliver({ serverContent: { interrupted: true } });
    live.deliver(AUDIO);
    expect(player.play).toHaveBeenCalledOnce();
  });

  it("of which the model does not know is answered without being carried out", async () => {
    const { conversation, live, desk } = await begun();
    conversation.say("drive");
    live.deliver(AUDIO);
    conversation.interrupt();
    live.deliver(call("late", "drive", { duration_s: 1 }));
    expect(calls(desk)).toEqual([]);
    expect(JSON.stringify(live.sent.at(-1))).toContain("the operator interrupted");
  });

  it("of which a call is being carried out does not answer it", async () => {
    const { conversation, live, answer } = await begun();
    conversation.say("where are you?");
    live.deliver(call("1"));
    conversation.beginSpeech();
    live.sent.length = 0;
    await answer("1", { ok: true });
    expect(live.sent).toEqual([]);
    expect(view().calls).toMatchObject([{ state: "done" }]);
  });

  it("ends the burst if the operator pressed the button", async () => {
    const { conversation, live, desk } = await begun();
    conversation.say("drive");
    live.deliver(AUDIO);
    conversation.interrupt();
    expect(desk.sent).toContainEqual({ cancel: true });
    expect(turns(desk).at(-1)).toMatchObject({ by: "button", ended: true });
  });

  it("falls silent at a stop, and its turn goes on", async () => {
    const { conversation, live, player } = await begun();
    conversation.say("stop the robot");
    live.deliver(AUDIO);
    player.play.mockClear();
    conversation.silence();
    expect(player.flush).toHaveBeenCalled();
    live.deliver(AUDIO);
    expect(player.play).toHaveBeenCalledOnce();
  });
});

describe("the sound of the microphone", () => {
  const FRAME = new Int16Array(800).fill(7);
  const LISTENING = { mode: "stops" as const, startLevel: 0.02, endLevel: 0.012 };

  it("goes to the console between turns and while the agent speaks", async () => {
    const { conversation, live, desk } = await begun();
    conversation.overhear(FRAME);
    expect(desk.frames).toHaveLength(0);
    conversation.listen(LISTENING);
    expect(desk.sent.at(-1)).toEqual({ listen: { mode: "stops", start_level: 0.02, end_level: 0.012 } });
    conversation.overhear(FRAME);
    conversation.say("hello");
    live.deliver(AUDIO);
    conversation.overhear(FRAME);
    expect(desk.frames.map((frame) => [...new Int16Array(frame)])).toEqual([[...FRAME], [...FRAME]]);
    expect(kinds(live)).toEqual(["clientContent"]);
  });

  it("is dropped where the network takes no more", async () => {
    const { conversation, desk } = await begun();
    conversation.listen(LISTENING);
    desk.bufferedAmount = 20_000;
    conversation.overhear(FRAME);
    expect(desk.frames).toHaveLength(0);
  });

  it("is not sent where the console hears nothing", async () => {
    const { conversation, desk } = await begun();
    conversation.listen(LISTENING);
    for (const state of ["starting", "missing", "failed", "busy", "ready"]) {
      desk.deliver({ state: { listener: { state, reason: "" } } });
      conversation.overhear(FRAME);
    }
    expect(desk.frames).toHaveLength(2);
  });

  it("is listened to again by a console that was away, and no longer once it ends", async () => {
    const { conversation, desk } = await begun();
    conversation.listen(LISTENING);
    desk.end(1006);
    conversation.overhear(FRAME);
    await vi.advanceTimersByTimeAsync(1500);
    desk.open();
    expect(desk.sent.filter(({ listen }) => listen !== undefined)).toHaveLength(2);
    conversation.listen(null);
    expect(desk.sent.at(-1)).toEqual({ listen: { mode: "off" } });
    conversation.overhear(FRAME);
    expect(desk.frames).toHaveLength(0);
  });

  it("with a word for stopping silences the agent, and is noted", async () => {
    const { desk, player } = await begun();
    desk.deliver({ state: { listener: { state: "ready", reason: "" } } });
    expect(view().console?.listener).toEqual({ state: "ready", reason: "" });
    desk.deliver({ stop_heard: "please stop" });
    expect(player.flush).toHaveBeenCalled();
    expect(view().transcript.at(-1)).toMatchObject({ who: "page" });
  });
});

describe("what was read back", () => {
  async function readBack() {
    const all = await begun();
    all.conversation.say("go home");
    all.live.deliver(call("1", "nav_goto_named", { name: "home" }));
    await all.answer("1", { ok: false, confirm: "navigate to the location home", confirmation: "abcd" });
    return all;
  }

  it("is shown, and forgotten by the next turn", async () => {
    const { conversation } = await readBack();
    expect(view().readBack).toMatchObject({ tool: "nav_goto_named", sentence: "navigate to the location home", confirmation: "abcd" });
    expect(view().calls).toMatchObject([{ state: "read_back" }]);
    conversation.beginSpeech();
    expect(view().readBack).toBeNull();
  });

  it("is carried out by the button as it was read", async () => {
    const { conversation, desk, live } = await readBack();
    const done = conversation.confirm();
    const made = calls(desk).at(-1);
    expect(turns(desk).at(-1)).toMatchObject({ by: "button", ended: true });
    expect(made).toMatchObject({ name: "nav_goto_named", arguments: { name: "home", confirmation: "abcd" } });
    desk.deliver({ result: { id: made?.["id"], name: "nav_goto_named", response: { ok: true } } });
    await done;
    expect(view().readBack).toBeNull();
    expect(view().calls.at(-1)).toMatchObject({ state: "done", byOperator: true });
    expect(JSON.stringify(live.sent.at(-1))).toContain("pressed Confirm");
  });

  it("is refused by the other button", async () => {
    const { conversation, desk, live } = await readBack();
    conversation.refuse();
    expect(desk.sent).toContainEqual({ cancel: true });
    expect(calls(desk)).toHaveLength(1);
    expect(JSON.stringify(live.sent.at(-1))).toContain("pressed Cancel");
  });
});

describe("the view", () => {
  it("puts the parts of what is said together", async () => {
    const { conversation, live } = await begun();
    conversation.say("hello");
    for (const text of ["Good", " morning", "."]) live.deliver({ serverContent: { outputTranscription: { text } } });
    live.deliver(DONE);
    live.deliver({ serverContent: { outputTranscription: { text: "Yes?" } } });
    expect(view().transcript.map(({ text }) => text)).toEqual(["hello", "Good morning.", "Yes?"]);
  });

  it("keeps an utterance before its answer, also where its words come later", async () => {
    const { conversation, live } = await begun();
    conversation.beginSpeech();
    conversation.endSpeech();
    live.deliver({ serverContent: { outputTranscription: { text: "Here." } } });
    live.deliver({ serverContent: { inputTranscription: { text: " where are you?" } } });
    expect(view().transcript).toMatchObject([
      { who: "operator", text: "where are you?" },
      { who: "agent", text: "Here." },
    ]);
  });

  it("keeps 80 turns and 40 calls", async () => {
    const { conversation, live, answer } = await begun();
    for (let turn = 0; turn < 100; turn += 1) conversation.say(`turn ${turn}`);
    for (let each = 0; each < 50; each += 1) {
      live.deliver(call(`${each}`));
      await answer(`${each}`, { ok: true });
    }
    expect(view().transcript).toHaveLength(MAX_ENTRIES);
    expect(view().calls).toHaveLength(MAX_CALLS);
  });

  it("ends where another tab took the agent over", async () => {
    const { desk, ended, live } = await begun();
    desk.end(1008, "the voice agent of this browser goes on in another tab");
    expect(ended).toHaveBeenCalledOnce();
    expect(view().failure).toMatchObject({ phrase: { key: "voice_fail_moved" } });
    expect(live.isClosed).toBe(true);
  });
});
