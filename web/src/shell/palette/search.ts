/** Which commands a typed query finds. */

/**
 * From 0, not found, to 1. Every typed word begins a word of the label, so that Enter never runs a command that was not meant:
 * a search for scattered letters would find one where the wanted command cannot be given.
 */
export function scoreOf(label: string, query: string): number {
  const words = fold(label).split(/[^\p{L}\p{N}]+/u);
  const wanted = fold(query).split(/\s+/).filter((word) => word !== "");
  if (!wanted.every((part) => words.some((word) => word.startsWith(part)))) return 0;
  return wanted[0] === undefined || words[0]?.startsWith(wanted[0]) === true ? 1 : 0.5;
}

/** Without case and accents: "wächst" is found by "wachst". */
function fold(text: string): string {
  return text.normalize("NFD").replace(/\p{M}/gu, "").toLowerCase();
}
