/** Ends whatever is being held: nothing that was begun before a stop acts after it. */
const holds = new EventTarget();

export function endHolds(): void {
  holds.dispatchEvent(new Event("end"));
}

/** Call `end` whenever holds end; the returned function forgets it. */
export function onHoldsEnd(end: () => void): () => void {
  holds.addEventListener("end", end);
  return () => holds.removeEventListener("end", end);
}
