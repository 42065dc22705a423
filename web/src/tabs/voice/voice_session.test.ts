// @vitest-environment jsdom
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { LIVE, useRewind } from "@/state/rewind";
import { changeSettings } from "@/state/settings";
import { FakeSocket } from "./live/fake_socket";
import { beginTalk, endTalk, endVoice, say, startVoice } from "./voice_session";
import { EMPTY_VIEW, useVoice } from "./voice_store";

const parts = vi.hoisted(() => ({ take: (_frame: Int16Array) => {}, desk: null as unknown }));
vi.mock("./audio/microphone", () => ({
  offersMicrophone: () => true,
  Microphone: {
    open: async (_context: unknown, take: (frame: Int16Array) => void) => {
      parts.take = take;
      return { close: () => {} };
    },
  },
}));
vi.mock("@/api/sockets", async (original) => ({ ...(await original<object>()), openSocket: () => parts.desk }));

class FakeAudio {
  currentTime = 0;
  destination = {};
  resume = async () => {};
  close = async () => {};
  createBuffer = () => ({ copyToChannel: () => {}, duration: 1 });
  createBufferSource = () => ({ buffer: null, onended: null, connect: () => {}, start: () => {}, stop: () => {}, disconnect: () => {} });
}

const LOUD = new Int16Array(800).fill(8000);
const SILENT = new Int16Array(800);
let desk: FakeSocket;

beforeEach(async () => {
  vi.stubGlobal("AudioContext", FakeAudio);
  useVoice.setState(EMPTY_VIEW);
  desk = new FakeSocket();
  parts.desk = desk;
  await changeSettings({ voicePushToTalk: true, voiceLanguage: "en-US" });
  startVoice("offline");
  await vi.waitUntil(() => useVoice.getState().microphone === "on");
  desk.open();
});
afterEach(() => {
  useRewind.setState(LIVE);
  endVoice();
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
});

const hear = (frame: Int16Array, times = 1) => {
  for (let each = 0; each < times; each += 1) parts.take(frame);
};
const turns = () => desk.sent.filter(({ turn }) => turn !== undefined).length;

it("an open microphone is heard by the console, whether its button is pressed or not, in a hidden page too", () => {
  expect(desk.sent).toContainEqual({ listen: { mode: "commands", start_level: 0.02, end_level: 0.012 } });
  hear(LOUD);
  beginTalk();
  hear(LOUD);
  endTalk();
  vi.spyOn(document, "hidden", "get").mockReturnValue(true);
  hear(LOUD);
  expect(desk.frames).toHaveLength(3);
  expect(turns()).toBe(2);
});

it("what is heard while the agent speaks is no turn, and is still heard for stops", async () => {
  await changeSettings({ voicePushToTalk: false });
  desk.deliver(new ArrayBuffer(200));
  hear(LOUD, 10);
  hear(SILENT, 20);
  expect(turns()).toBe(0);
  expect(desk.frames).toHaveLength(30);
});

it("an open microphone makes turns once the agent is silent", async () => {
  await changeSettings({ voicePushToTalk: false });
  hear(LOUD, 10);
  hear(SILENT, 20);
  expect(turns()).toBe(2);
});

it("a listener that failed is asked for again when the operator begins to speak", () => {
  const asked = () => desk.sent.filter(({ listen }) => listen !== undefined).length;
  beginTalk();
  endTalk();
  expect(asked()).toBe(1);
  desk.deliver({ state: { listener: { state: "failed", reason: "it ended by itself; start again" } } });
  beginTalk();
  expect(asked()).toBe(2);
});

it("in Dutch only stops are heard, as speech is recognized in English", async () => {
  endVoice();
  await changeSettings({ voiceLanguage: "nl-NL" });
  startVoice("offline");
  await vi.waitUntil(() => useVoice.getState().microphone === "on");
  desk.open();
  expect(desk.sent.at(-1)).toMatchObject({ listen: { mode: "stops" } });
  beginTalk();
  expect(turns()).toBe(0);
});

it("what a page that shows the past refuses stands in the console's journal", () => {
  useRewind.setState({ shownS: 1 });
  say("go to the sink");
  expect(desk.sent.at(-1)).toMatchObject({ refused: { name: "say", arguments: { text: "go to the sink" }, reason: expect.stringContaining("past") } });
});
