/** The stored poses and sequences, read again whenever they may have changed. */
import { useCallback, useEffect, useState } from "react";
import { SERVICES } from "@/generated/graph";
import { errorText } from "@/i18n/error_text";
import { useText } from "@/i18n/text";
import { call } from "@/robot/commands";
import { useLink } from "@/robot/link";
import { type Library, parseLibrary } from "./library";

export interface LibraryReading {
  library: Library | null;
  /** Why it could not be read; empty while it can. */
  problem: string;
  reload: () => void;
}

/** `isBusy`: the library records or replays; afterwards it may have a new entry. */
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
      .catch((error: unknown) => setProblem(errorText(error)));
  }, [text]);

  useEffect(() => {
    if (isLinkOpen && !isBusy) reload();
  }, [isLinkOpen, isBusy, reload]);

  return { library, problem, reload };
}
