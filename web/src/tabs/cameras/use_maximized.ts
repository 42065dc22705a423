import { useEffect, useState } from "react";

/**
 * Whether the image fills the page. The whole page goes to full screen and not the image alone, as nothing may cover the
 * stop. Escape leaves both.
 */
export function useMaximized(): [boolean, (maximized: boolean) => void] {
  const [isMaximized, setMaximized] = useState(false);

  useEffect(() => {
    const onChange = () => document.fullscreenElement === null && setMaximized(false);
    const onKey = (event: KeyboardEvent) => event.key === "Escape" && change(false);
    document.addEventListener("fullscreenchange", onChange);
    document.addEventListener("keydown", onKey);
    return () => {
      document.removeEventListener("fullscreenchange", onChange);
      document.removeEventListener("keydown", onKey);
    };
  }, []);

  function change(maximized: boolean): void {
    setMaximized(maximized);
    // Where the browser allows no full screen, as on some phones, the image fills its window.
    if (maximized) document.documentElement.requestFullscreen?.().catch(() => {});
    else if (document.fullscreenElement !== null) document.exitFullscreen().catch(() => {});
  }

  return [isMaximized, change];
}
