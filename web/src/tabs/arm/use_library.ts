/** The stored poses and sequences, read again whenever they may have changed. */
import { useCallback, useEffect, useState } from "react";
import { SERVICES } from "@/generated/graph";
import { useText } from "@/i18n/text";
import { call, useLink } from "@/robot";
import { type Library, parseLibrary } from "./library";

export interface LibraryReading {
  library: Library | null;
  /** Why it could not be read; empty while it can. */
  problem: string;
  reload: () => void;
}

/** `isBusy`: while the library records or replays; a new entry is there after it. */
export function useLibrary(isBusy: boolean): LibraryReading {
  const text = useText();
  const [library, setLibrary] = useState<Library | null>(null);
  const [problem, setProblem] = useState("");
  const isLinkOpen = useLink((link) => link.state === "open");

  const reload = useCallback(() => {
    call(SERVICES.ARM_LIBRARY_LIST, {})
      .then((answer) => {
        const read = answer.success ? parseLibrary(answer.json) : null;
        setLibrary(read);
        setProblem(read === null ? text("arm_library_damaged") : "");
      })
      .catch((error: unknown) => setProblem(error instanceof Error ? error.message : String(error)));
  }, [text]);

  useEffect(() => {
    if (isLinkOpen && !isBusy) reload();
  }, [isLinkOpen, isBusy, reload]);

  return { library, problem, reload };
}
