/** Which tab is shown: the part of the address behind #. */
import { create } from "zustand";
import { TAB_IDS, type TabId } from "./tab_ids";

function fromAddress(): TabId {
  const name = location.hash.slice(1).split("?")[0];
  return TAB_IDS.find((id) => id === name) ?? "map";
}

export const useRoute = create<{ tab: TabId }>(() => ({ tab: fromAddress() }));

export function showTab(tab: TabId): void {
  if (location.hash !== `#${tab}`) history.replaceState(null, "", `#${tab}`);
  useRoute.setState({ tab });
}

window.addEventListener("hashchange", () => useRoute.setState({ tab: fromAddress() }));
