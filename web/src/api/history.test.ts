// @vitest-environment jsdom
import { beforeEach, expect, it, vi } from "vitest";
import { useLanguage } from "@/i18n/text";
import { type ConsoleEvent, useConsole } from "./console_store";

const event = (number: number, kind: string, name = "phone-1", other = ""): ConsoleEvent => ({ number, robot_s: number, kind, name, other });
const numbers = (events: readonly ConsoleEvent[]) => events.map(({ number }) => number);

/** The module as a page that was just opened has it. */
async function opened() {
  vi.resetModules();
  vi.doMock("./console_store", () => ({ useConsole }));
  vi.doMock("@/state/problems", async () => await vi.importActual("@/state/problems"));
  const history = await import("./history");
  const answer = (events: ConsoleEvent[]) => vi.stubGlobal("fetch", () => Promise.resolve(new Response(JSON.stringify({ events, mission: [] }), { headers: { "Content-Type": "application/json" } })));
  return { ...history, answer, said: async () => (await import("@/state/problems")).useMessages.getState().messages.map(({ text }) => text) };
}

beforeEach(() => {
  useLanguage.setState({ language: "en" });
  useConsole.setState({ session: { name: "laptop-1", role: "operator" } });
});

it("joins what was before and what comes, each once and in order", async () => {
  const { useHistory, loadHistory, addEvents, answer } = await opened();
  addEvents([event(4, "control_taken")]);
  answer([1, 2, 3, 4].map((number) => event(number, "stop_pressed")));
  await loadHistory();
  addEvents([event(5, "stop_released"), event(4, "control_taken")]);
  expect(numbers(useHistory.getState().events)).toEqual([1, 2, 3, 4, 5]);
});

it("says nothing of the past after a reload, and everything that concerns this browser after that", async () => {
  const { loadHistory, addEvents, answer, said } = await opened();
  answer([event(1, "control_taken_over", "phone-1", "laptop-1")]);
  await loadHistory();
  expect(await said()).toEqual([]);
  addEvents([event(2, "control_taken_over", "phone-1", "laptop-1")]);
  addEvents([event(3, "control_taken_over", "phone-1", "phone-2"), event(4, "control_unanswered", "laptop-1", "phone-1")]);
  expect(await said()).toEqual(["You have lost control: phone-1 has taken it over.", "phone-1 has not answered: you have no control. Ask again, or take over."]);
});

it("says after an outage what happened in it", async () => {
  const { loadHistory, answer, said } = await opened();
  answer([event(1, "control_taken", "laptop-1")]);
  await loadHistory();
  answer([event(1, "control_taken", "laptop-1"), event(2, "control_expired", "laptop-1")]);
  await loadHistory();
  expect(await said()).toEqual(["You have lost control: this browser did not answer for 5 s."]);
});

it("takes the history of another server for the one before it", async () => {
  const { loadHistory, answer, said } = await opened();
  answer([7, 8].map((number) => event(number, "stop_pressed")));
  await loadHistory();
  answer([event(1, "control_taken_over", "phone-1", "laptop-1")]);
  await loadHistory();
  expect(await said()).toEqual([]);
});
