import { describe, expect, it } from "vitest";
import { stopReasons } from "./stop_reasons";

const CONSOLE = "a browser of the console holds the stop";
const FACTS = { own: "", name: "laptop-1", server: [], robot: [] };

describe("the reasons of a stop", () => {
  it("begin with this page's own, in its words only", () => {
    const facts = { ...FACTS, own: "by you", server: ["phone-2 holds the stop", "laptop-1 holds the stop"], robot: ["the button is pressed", CONSOLE] };
    expect(stopReasons(facts)).toEqual(["by you", "phone-2 holds the stop", "the button is pressed"]);
  });

  it("keep what the server says of this browser while the page states nothing itself", () => {
    expect(stopReasons({ ...FACTS, server: ["laptop-1 was lost while it was driving"] })).toEqual(["laptop-1 was lost while it was driving"]);
  });

  it("name a console where only the robot knows of one", () => {
    expect(stopReasons({ ...FACTS, robot: [CONSOLE] })).toEqual([CONSOLE]);
    expect(stopReasons(FACTS)).toEqual([]);
  });
});
