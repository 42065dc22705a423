/** What the robot and the console say in their own words, in the page's language where the sentence is one of their table. */
import { SENTENCES } from "@/generated/sentences";
import { withDecimalMark } from "@/ui/numbers";
import { type Language, type Sentences, sentencesIn, type TextValues } from "./text";

type SentenceName = keyof Sentences;

const PLACE = /\{(\w+)\}/g;
const NUMBER = /^[+-]?\d+(?:\.\d+)?$/;
const VALUES: Readonly<Record<string, string>> = { seconds: "\\d+(?:\\.\\d+)?", process: "[^ ,]+" };

const TEMPLATES = (Object.keys(SENTENCES) as SentenceName[]).map((name) => {
  const pattern = SENTENCES[name].replace(/[.*+?^$()|[\]\\]/g, "\\$&").replace(PLACE, (_, place: string) => `(?<${place}>${VALUES[place] ?? ".+"})`);
  return { name, pattern: new RegExp(`^${pattern}$`, "s") };
});

/** A sentence in a language, or several with commas between them; as it is where the table has no such sentence. */
export function wordsIn(language: Language, words: string): string {
  return translated(language, words) ?? words;
}

/** The values of a text, with the names of voice agents in a language: a browser's own name has none. */
export function namedIn(language: Language, values: TextValues): TextValues {
  const inWords = (value: string | number) => (typeof value === "string" ? wordsIn(language, value) : value);
  return Object.fromEntries(Object.entries(values).map(([key, value]) => [key, NAMES.includes(key) ? inWords(value) : value]));
}

const NAMES = ["name", "other"];
const DETAIL = "detail_";
const DETAIL_NAMES = (Object.keys(SENTENCES) as SentenceName[]).filter((name) => name.startsWith(DETAIL)).sort((one, other) => other.length - one.length);

/** Why a tag was not visited, in words that `wordsIn` knows: the mission sends a code, which may have more at its end. */
export function explained(detail: string): string {
  const name = DETAIL_NAMES.find((each) => detail.startsWith(each.slice(DETAIL.length)));
  return name === undefined ? detail : SENTENCES[name];
}

/** Whether `wordsIn` returns words of another language than the page's. */
export function isForeign(language: Language, words: string): boolean {
  return language !== "en" && translated(language, words) === null;
}

function translated(language: Language, words: string): string | null {
  const sentences = sentencesIn(language);
  if (sentences === null) return null;
  const found = sentence(sentences, words);
  if (found !== null || !words.includes(", ")) return found;
  const parts = words.split(", ").map((part) => sentence(sentences, part));
  return parts.every((part) => part !== null) ? parts.join(", ") : null;
}

function sentence(sentences: Sentences, words: string): string | null {
  for (const { name, pattern } of TEMPLATES) {
    const values = pattern.exec(words);
    if (values === null) continue;
    return sentences[name].replace(PLACE, (_, place: string) => {
      const value = values.groups?.[place] ?? "";
      return place !== "name" && NUMBER.test(value) ? withDecimalMark(value) : (sentence(sentences, value) ?? value);
    });
  }
  return null;
}
