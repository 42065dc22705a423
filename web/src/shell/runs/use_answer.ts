import { useEffect, useState } from "react";
import { getJson } from "@/api/http";
import { errorText } from "@/i18n/error_text";

export interface Answer<Value> {
  /** null before the first answer. */
  value: Value | null;
  problem: string;
}

/** What a path answers when the component appears. `read` must not change. */
export function useAnswer<Value>(path: string, read: (value: unknown) => Value): Answer<Value> {
  const [answer, setAnswer] = useState<Answer<Value>>({ value: null, problem: "" });
  useEffect(() => {
    let isMounted = true;
    getJson<unknown>(path).then(
      (value) => isMounted && setAnswer({ value: read(value), problem: "" }),
      (error: unknown) => isMounted && setAnswer({ value: null, problem: errorText(error) }),
    );
    return () => {
      isMounted = false;
    };
  }, [path, read]);
  return answer;
}
