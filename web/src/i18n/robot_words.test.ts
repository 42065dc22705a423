import { beforeAll, describe, expect, it } from "vitest";
import { SENTENCES } from "@/generated/sentences";
import { writeNumbersIn } from "@/ui/numbers";
import { sentences } from "./catalog/nl/sentences";
import { explained, isForeign, namedIn, wordsIn } from "./robot_words";
import { loadDutch } from "./text";

const placesOf = (template: string) => [...template.matchAll(/\{(\w+)\}/g)].map(([, place]) => place).toSorted();

beforeAll(loadDutch);

describe("the robot's own words", () => {
  it.each(Object.entries(SENTENCES))("%s has the same places in Dutch, and is found", (name, template) => {
    const dutch = sentences[name as keyof typeof SENTENCES];
    expect(placesOf(dutch)).toEqual(placesOf(template));
    const words = template.replace("{seconds}", "0.6").replace(/\{\w+\}/g, "x-1");
    expect(isForeign("nl", words)).toBe(false);
    expect(wordsIn("nl", words)).not.toBe(words);
    expect(wordsIn("en", words)).toBe(words);
  });

  it("explain the code of a detail, of which the longest that fits counts", () => {
    expect(wordsIn("nl", explained("nav_status_6"))).toBe("navigatie gaf het op: geen vrije weg naar de tag gevonden");
    expect(wordsIn("nl", explained("nav_status_4"))).toBe("navigatie eindigde zonder aankomst");
    expect(explained("amcl_drift_var=0.41")).toBe("the robot's pose was too uncertain");
    expect(explained("a detail of a later version")).toBe("a detail of a later version");
  });

  it("keep their values, with the page's decimal mark", () => {
    writeNumbersIn("nl");
    expect(wordsIn("nl", "no e-stop state for 0.6 s")).toBe("al 0,6 s geen toestand van de noodstop");
    writeNumbersIn("en");
    expect(wordsIn("nl", "hall (2) was not loaded: a mission is running (EXPLORING); abort it first, or wait for its end")).toBe(
      "hall (2) is niet geladen: er loopt een missie (EXPLORING); breek die eerst af of wacht tot ze klaar is",
    );
    expect(wordsIn("nl", "body does not respond, navigation has exited")).toBe("body reageert niet, navigation is gestopt");
  });

  it("name voice agents, and leave the names of browsers and places as they are", () => {
    expect(namedIn("nl", { name: "voice agent of phone-2", other: "laptop-1", count: 2 })).toEqual({ name: "spraakassistent van phone-2", other: "laptop-1", count: 2 });
    expect(wordsIn("nl", "voice agent of phone-2 stopped the robot")).toBe("spraakassistent van phone-2 heeft de robot gestopt");
    writeNumbersIn("nl");
    expect(wordsIn("nl", "navigate to the location row 1.5")).toBe("rijden naar de plaats row 1.5");
    expect(wordsIn("nl", "navigate to the location 1.5")).toBe("rijden naar de plaats 1.5");
    expect(wordsIn("nl", "navigate +1.5 m forward, -2 m to the left, turned by +0 degrees")).toBe("+1,5 m vooruit rijden, -2 m naar links, +0 graden gedraaid");
    writeNumbersIn("en");
  });

  it.each(["", "a reason of a later version", "the button is pressed, and something else"])("are left as they are where nobody knows them: %j", (words) => {
    expect(wordsIn("nl", words)).toBe(words);
    expect(isForeign("nl", words)).toBe(true);
  });
});
