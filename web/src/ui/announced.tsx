import type { ReactNode } from "react";

/** A text that changes all the time, such as an age, and what screen readers are told instead: once, when the state changes. */
export function Announced({ says, children }: { says: string; children: ReactNode }) {
  return (
    <>
      <span aria-hidden="true">{children}</span>
      <span role="status" className="sr-only">
        {says}
      </span>
    </>
  );
}
