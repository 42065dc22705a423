import { useEffect, useRef } from "react";
import { useLink } from "@/robot/link";
import { askForPath } from "./goal_actions";
import { useMapUi } from "./map_ui";

/** While a goal is dragged, the shortest time between two requests to the planner. */
const PERIOD_MS = 250;

/** Keeps the preview of the path to the drawn goal up to date. */
export function usePathPreview(): void {
  const pose = useMapUi((state) => (state.draft?.kind === "goal" ? state.draft.pose : null));
  const linkOpen = useLink((link) => link.state === "open");
  const lastMs = useRef(-Infinity);
  useEffect(() => {
    if (pose === null || !linkOpen) return;
    let giveUp = () => {};
    useMapUi.setState(({ preview }) => ({ preview: { points: preview?.points ?? [], problem: preview?.problem ?? null, isPending: true } }));
    const timer = setTimeout(
      () => {
        lastMs.current = performance.now();
        giveUp = askForPath(pose, (preview) => useMapUi.setState({ preview }));
      },
      Math.max(0, PERIOD_MS - (performance.now() - lastMs.current)),
    );
    return () => {
      clearTimeout(timer);
      giveUp();
    };
  }, [pose, linkOpen]);
}
