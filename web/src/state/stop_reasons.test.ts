// @vitest-environment jsdom
import { beforeAll, describe, expect, it } from "vitest";
import type { StopHold } from "@/api/console_store";
import { loadDutch, textIn } from "@/i18n/text";
import { type StopFacts, stopLines } from "./stop_reasons";

const CONSOLE = "a browser of the console holds the stop";
const FACTS: StopFacts = { own: null, name: "laptop-1", server: [], robot: [] };
const OWN = { press: "press:1", key: "reason_user", ageS: 12 } as const;

function held(name: string, press: string, kind: StopHold["kind"] = "pressed"): StopHold {
  return { kind, text: `${name} holds the stop`, press, name, age_s: 3 };
}

const button: StopHold = { kind: "robot", text: "the button is pressed", press: null, name: null, age_s: null };

function said(facts: StopFacts): string[] {
  return stopLines(facts).map(({ key, values, words }) => (key === null ? words : `${key} ${String(values["name"] ?? "")}`.trim()));
}

beforeAll(loadDutch);

describe("the reasons of a stop", () => {
  it("begin with this page's own, in its words only", () => {
    const facts = { ...FACTS, own: OWN, server: [held("phone-2", "press:2"), held("laptop-1", "press:1"), button], robot: ["the button is pressed", CONSOLE] };
    expect(said(facts)).toEqual(["reason_user", "held_pressed phone-2", "the button is pressed"]);
    expect(stopLines(facts).map(({ ageS }) => ageS)).toEqual([12, 3, null]);
  });

  it("know a former stop of this browser for its own", () => {
    const server = [held("laptop-1", "press:0", "lost_holding"), held("laptop-1", "press:9", "lost_driving")];
    expect(said({ ...FACTS, server })).toEqual(["held_lost_holding_here laptop-1", "held_lost_driving_here laptop-1"]);
    expect(said({ ...FACTS, own: OWN, server: [{ ...button, text: CONSOLE }] })).toEqual(["reason_user"]);
  });

  it("name a console where only the robot knows of one", () => {
    expect(said({ ...FACTS, robot: [CONSOLE] })).toEqual([CONSOLE]);
    expect(said(FACTS)).toEqual([]);
  });

  it.each(["pressed", "left", "lost_driving", "lost_holding", "lost_in_control", "not_back", "silent"] as const)("have words in both languages: %s", (kind) => {
    for (const name of ["laptop-1", "phone-2"]) {
      const [line] = stopLines({ ...FACTS, server: [held(name, "press:3", kind)] });
      const [english, dutch] = (["en", "nl"] as const).map((language) => textIn(language, line?.key ?? "stop", line?.values));
      expect(english).toContain(name === "laptop-1" ? "this browser" : "phone-2");
      expect(dutch).not.toBe(english);
    }
  });
});
