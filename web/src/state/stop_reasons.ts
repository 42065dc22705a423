/** Why the robot is stopped, for its banner: every cause once, with its age. */
import type { StopHold } from "@/api/console_store";
import type { TextKey, TextValues } from "@/i18n/text";

/** What the robot says of any stop that the console's server has combined; the server says whose it is. */
const OF_CONSOLES = "a browser of the console";

export interface StopFacts {
  /** This page's own stop: its press, the text of its reason and its age; null while it states none. */
  own: { press: string; key: TextKey; ageS: number | null } | null;
  /** This browser's name at the server. */
  name: string;
  /** What the server gives. */
  server: readonly StopHold[];
  /** The reasons that the robot's e-stop gives. */
  robot: readonly string[];
}

export interface StopLine {
  /** Null where the words are the robot's. */
  key: TextKey | null;
  values: TextValues;
  /** The robot's words; empty with a key. */
  words: string;
  ageS: number | null;
  /** Whose it is, so that it can be released; null for the robot's own. */
  name: string | null;
}

/** This page's own first, then those of consoles, then those of the robot. */
export function stopLines({ own, name, server, robot }: StopFacts): StopLine[] {
  const held = server.flatMap((hold) => lineOf(hold, name, own?.press ?? null) ?? []);
  const ofConsoles: StopLine[] = own === null ? held : [{ key: own.key, values: {}, words: "", ageS: own.ageS, name }, ...held];
  const words = [...server.filter(({ kind }) => kind === "robot").map(({ text }) => text), ...robot];
  const ofRobot = ofConsoles.length === 0 ? words : words.filter((each) => !each.startsWith(OF_CONSOLES));
  return [...ofConsoles, ...[...new Set(ofRobot)].map((each) => ({ key: null, values: {}, words: each, ageS: null, name: null }))];
}

function lineOf(hold: StopHold, ownName: string, ownPress: string | null): StopLine | null {
  if (hold.kind === "robot" || hold.name === null || hold.press === ownPress) return null;
  const line = { values: { name: hold.name }, words: "", ageS: hold.age_s, name: hold.name };
  return { ...line, key: `held_${hold.kind}${hold.name === ownName ? "_here" : ""}` };
}
