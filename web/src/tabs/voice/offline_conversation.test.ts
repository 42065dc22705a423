import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { FakeSocket } from "./live/fake_socket";
import { OfflineConversation, type OfflineParts } from "./offline_conversation";
import { EMPTY_VIEW, useVoice } from "./voice_store";

type Message = Record<string, Record<string, unknown>>;

beforeEach(() => {
  vi.useFakeTimers();
  useVoice.setState(EMPTY_VIEW);
});
afterEach(() => vi.useRealTimers());

function begun(parts: Partial<OfflineParts> = {}) {
  const desk = new FakeSocket();
  const player = { play: vi.fn(), flush: vi.fn() };
  const ended = vi.fn();
  let nowMs = 0;
  const conversation = new OfflineConversation({
    consoleUrl: "ws://console/_api/voice",
    openConsole: () => desk,
    player,
    language: () => "en",
    isClosed: () => false,
    inWords: ({ phrase }) => phrase?.key ?? "",
    translated: (words) => words,
    ended,
    now: () => nowMs,
    ...parts,
  });
  conversation.start();
  desk.open();
  const all = (kind: string) => (desk.sent as Message[]).flatMap((message) => (message[kind] === undefined ? [] : [message[kind]]));
  const reply = (id: unknown, fields: object) => desk.deliver({ reply: { id, message: "", done: false, call: null, response: null, read_back: null, ...fields } });
  return { conversation, desk, player, ended, all, reply, wait: (ms: number) => (nowMs += ms) };
}

const view = () => useVoice.getState();
const GOTO = { tool: "nav_goto_named", arguments: { name: "home" } };
const ASKED = { message: "Navigate to the location home. Yes or no?", call: GOTO, read_back: "navigate to the location home", response: { ok: false, confirm: "navigate to the location home", confirmation: "abcd" } };

describe("a typed sentence", () => {
  it("goes to the console, and its reply and call are shown", () => {
    const { conversation, all, reply, wait } = begun({ language: () => "nl" });
    conversation.say("lampen blauw");
    const [said] = all("say");
    expect(said).toMatchObject({ text: "lampen blauw", language: "nl" });
    expect(view().isThinking).toBe(true);
    wait(40);
    reply(said?.["id"], { message: "set_light: done", call: { tool: "set_light", arguments: { color: "blue" } }, response: { ok: true } });
    expect(view().transcript).toMatchObject([{ who: "operator", text: "lampen blauw" }, { who: "agent", text: "set_light: done" }]);
    expect(view().calls).toMatchObject([{ tool: "set_light", state: "done" }]);
    expect(view()).toMatchObject({ isThinking: false, latency: { callMs: 40, soundMs: null } });
  });

  it("to speak writes to the transcript", () => {
    const { conversation, all, reply } = begun();
    conversation.say("say good morning");
    reply(all("say")[0]?.["id"], { message: "speak: done", call: { tool: "speak", arguments: { text: "good morning" } }, response: { ok: true } });
    expect(view().transcript.at(-1)).toMatchObject({ who: "note", text: "good morning" });
  });

  it("from a page that nobody has released moves nothing: the console is told before", () => {
    const isClosed = vi.fn(() => true);
    const { conversation, desk } = begun({ isClosed });
    expect(desk.sent).toEqual([{ closed: true }]);
    isClosed.mockReturnValue(false);
    conversation.say("drive");
    expect(desk.sent.slice(1).map((message) => Object.keys(message)[0])).toEqual(["closed", "say"]);
    expect(desk.sent[1]).toEqual({ closed: false });
  });
});

describe("a spoken sentence", () => {
  it("is a turn, of which the console has the sound", () => {
    const { conversation, desk, all, player } = begun();
    conversation.listen({ mode: "commands", startLevel: 0.02, endLevel: 0.012 });
    conversation.overhear(new Int16Array(800));
    conversation.beginSpeech();
    expect(player.flush).toHaveBeenCalled();
    conversation.endSpeech();
    conversation.endSpeech();
    const [begin, end] = all("turn");
    expect([begin, end]).toEqual([{ id: begin?.["id"], by: "speech", ended: false }, { id: begin?.["id"], by: "speech", ended: true }]);
    expect(desk.frames).toHaveLength(1);
    desk.deliver({ heard: { id: begin?.["id"], text: "where are you", problem: "" } });
    expect(view().transcript).toMatchObject([{ who: "operator", text: "where are you" }]);
    expect(view().isThinking).toBe(true);
  });

  it("that was not understood or comes late says so", () => {
    const { conversation, desk, all } = begun();
    conversation.beginSpeech();
    conversation.endSpeech();
    desk.deliver({ heard: { id: all("turn")[0]?.["id"], text: "", problem: "the listener is starting" } });
    expect(view()).toMatchObject({ isThinking: false, transcript: [{ who: "page", text: "the listener is starting" }] });
  });

  it("with a word for stopping ends the turn", () => {
    const { conversation, desk, all, player } = begun();
    conversation.beginSpeech();
    desk.deliver({ stop_heard: "stop" });
    conversation.endSpeech();
    expect(all("turn")).toHaveLength(1);
    expect(player.flush).toHaveBeenCalled();
    expect(view()).toMatchObject({ isThinking: false, transcript: [{ who: "page", text: "voice_stop_heard" }] });
  });

  it("is answered by a sound", () => {
    const { desk, player } = begun();
    desk.deliver(Int16Array.from([0, 16_384]).buffer);
    expect(player.play).toHaveBeenCalledExactlyOnceWith(Float32Array.from([0, 0.5]), 16_000);
  });
});

describe("what was read back", () => {
  function readBack() {
    const all = begun();
    all.conversation.say("go home");
    all.reply(all.all("say")[0]?.["id"], ASKED);
    return all;
  }

  it("is shown, and forgotten by the next turn", () => {
    const { conversation } = readBack();
    expect(view().readBack).toMatchObject({ tool: "nav_goto_named", sentence: "navigate to the location home" });
    expect(view().calls).toMatchObject([{ state: "read_back" }]);
    conversation.beginSpeech();
    expect(view().readBack).toBeNull();
  });

  it("is answered by a button in a turn of its own", () => {
    for (const agrees of [true, false]) {
      const { conversation, all } = readBack();
      if (agrees) conversation.confirm();
      else conversation.refuse();
      conversation.confirm();
      expect(all("answer")).toEqual([{ id: all("answer")[0]?.["id"], agrees }]);
      expect(all("answer")[0]?.["id"]).not.toBe(all("say")[0]?.["id"]);
      expect(view().readBack).toBeNull();
    }
  });

  it("is not shown for a turn that is over", () => {
    const { conversation, all, reply } = begun();
    conversation.say("go home");
    conversation.interrupt();
    reply(all("say")[0]?.["id"], ASKED);
    expect(view()).toMatchObject({ readBack: null, isThinking: false });
  });
});

describe("the conversation", () => {
  it("waits for nothing once the console is away", () => {
    const { conversation, desk } = begun();
    conversation.say("where are you");
    desk.end(1006);
    expect(view()).toMatchObject({ isConsoleOpen: false, isThinking: false, readBack: null });
  });

  it("ends where another tab took the agent over", () => {
    const { desk, ended } = begun();
    desk.end(1008);
    expect(ended).toHaveBeenCalledOnce();
    expect(view()).toMatchObject({ session: "off", failure: { phrase: { key: "voice_fail_moved" } } });
  });
});
