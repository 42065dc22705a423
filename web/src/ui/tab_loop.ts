/** Tab in an open dialog goes round through the dialog and the stop, and nowhere else: what is behind it does nothing. */

const FOCUSABLE = 'a[href], button:not([disabled]), input:not([disabled]), select:not([disabled]), textarea:not([disabled]), summary, [tabindex]:not([tabindex="-1"])';

/** The dialogs that are open, the topmost last. */
const open: HTMLElement[] = [];

function onKey(event: KeyboardEvent): void {
  const dialog = open.at(-1);
  if (event.key !== "Tab" || event.ctrlKey || event.altKey || event.metaKey || dialog === undefined) return;
  const active = document.activeElement;
  // A menu of the dialog lies outside of it, and has keys of its own.
  if (active instanceof HTMLElement && active.closest("[data-radix-popper-content-wrapper]") !== null) return;
  const stops = [...document.querySelectorAll<HTMLElement>("[data-stop]")];
  const places = [...dialog.querySelectorAll<HTMLElement>(FOCUSABLE), ...stops].filter((element) => isReachable(element));
  if (places.length === 0) return;
  event.preventDefault();
  // Radix goes round within the dialog alone.
  event.stopPropagation();
  const index = places.findIndex((element) => element === active);
  const step = event.shiftKey ? -1 : 1;
  const next = index === -1 ? (event.shiftKey ? places.length - 1 : 0) : (index + step + places.length) % places.length;
  places[next]?.focus();
}

function isReachable(element: HTMLElement): boolean {
  // Of radio buttons and tabs, only one is reached by Tab.
  return element.tabIndex >= 0 && (element.checkVisibility?.() ?? true);
}

/** Keep Tab within a dialog and the stop; returns the function that ends it. */
export function loopTab(dialog: HTMLElement): () => void {
  if (open.length === 0) document.addEventListener("keydown", onKey, { capture: true });
  open.push(dialog);
  return () => {
    open.splice(open.indexOf(dialog), 1);
    if (open.length === 0) document.removeEventListener("keydown", onKey, { capture: true });
  };
}
