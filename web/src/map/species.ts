/** The species of flowers: their colors on the map and their names. */
import type { TextKey } from "@/i18n/text";

const SPECIES: Record<string, { color: string; name: TextKey }> = {
  tulip_red: { color: "#e23a3a", name: "map_tulip_red" },
  tulip_white: { color: "#e8e8ee", name: "map_tulip_white" },
  tulip_pink: { color: "#ec6aa6", name: "map_tulip_pink" },
};
const OTHER_COLOR = "#9aa0aa";
export const STEM_COLOR = "#4f9a5e";

export function speciesColor(species: string): string {
  return SPECIES[species]?.color ?? OTHER_COLOR;
}

/** The text of a species; null if the page does not know the species, which is then shown under its own name. */
export function speciesName(species: string): TextKey | null {
  return species === "" ? "map_unclassified" : (SPECIES[species]?.name ?? null);
}

/** The colors of the states of health on the map: for marks, never for text. */
export const HEALTH_COLORS = { healthy: "#3ec46d", off_range: "#e0b341", stressed: "#e0b341", critical: "#e23a3a", no_data: OTHER_COLOR } as const;
