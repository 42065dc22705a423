/** What the mock says is what the robot and the console say. */
import { SENTENCES } from "@/generated/sentences";

/** A sentence with its places filled. */
export function say(name: keyof typeof SENTENCES, values: Record<string, string | number> = {}): string {
  return SENTENCES[name].replace(/\{(\w+)\}/g, (_, place: string) => String(values[place] ?? ""));
}
