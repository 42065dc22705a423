/** Which tab is shown: the part of the address behind #. */
import { create } from "zustand";
import type { TabId } from "@/tabs/table";

const IDS: readonly TabId[] = ["teleop", "arm", "voice", "cameras", "telemetry", "logs", "map"];

function fromAddress(): TabId {
  const name = location.hash.slice(1).split("?")[0];
  return IDS.find((id) => id === name) ?? "map";
}

export const useRoute = create<{ tab: TabId }>(() => ({ tab: fromAddress() }));

export function showTab(tab: TabId): void {
  if (location.hash !== `#${tab}`) history.replaceState(null, "", `#${tab}`);
  useRoute.setState({ tab });
}

window.addEventListener("hashchange", () => useRoute.setState({ tab: fromAddress() }));
