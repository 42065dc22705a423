/** Whose a pressed key is: that of what has the focus, or the page's. */

/** Inputs that take no text. */
const WITHOUT_TEXT = ["checkbox", "radio", "range", "button"];

/** Whether a key pressed there is text. */
export function isTyping(target: EventTarget | null): boolean {
  if (!(target instanceof HTMLElement)) return false;
  if (target.isContentEditable || target instanceof HTMLTextAreaElement) return true;
  return target instanceof HTMLInputElement && !WITHOUT_TEXT.includes(target.type);
}

/** Whether a space pressed there is text: no number has one. */
export function isTypingSpace(target: EventTarget | null): boolean {
  return isTyping(target) && !(target instanceof HTMLInputElement && (target.type === "number" || target.inputMode === "numeric" || target.inputMode === "decimal"));
}

/** Whether a pressed key is a shortcut of the page: no text, no choice from a list, and no shortcut of the browser. */
export function isShortcut(event: KeyboardEvent): boolean {
  const { target } = event;
  return !(event.ctrlKey || event.metaKey || event.altKey || event.repeat || isTyping(target) || target instanceof HTMLSelectElement);
}
