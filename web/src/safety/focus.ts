/** Whether the window lost the focus, or only handed it to a frame of the page. */

/**
 * Calls `letGo` whenever keys do not arrive here any more, and `lost` if the focus left the window.
 *
 * A click into a frame, such as the report of a run, takes the focus from the page but not from its window. It is fetched back
 * at once, as the space bar would not stop the robot from within the frame; its links and buttons still work.
 */
export function followFocus(letGo: () => void, lost: () => void): void {
  window.addEventListener("blur", () => {
    letGo();
    // Some browsers name the frame as the active element only after this event.
    setTimeout(() => {
      const { activeElement } = document;
      if (!(activeElement instanceof HTMLIFrameElement)) {
        lost();
        return;
      }
      activeElement.blur();
      window.focus();
    });
  });
}
