import { isForeign, wordsIn } from "@/i18n/robot_words";
import { useLanguage } from "@/i18n/text";

/** What the robot or the console says: in the page's language, or marked as English. */
export function RobotWords({ words }: { words: string }) {
  const language = useLanguage((store) => store.language);
  return <span lang={isForeign(language, words) ? "en" : undefined}>{wordsIn(language, words)}</span>;
}
