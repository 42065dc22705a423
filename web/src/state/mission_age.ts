/** The mission's state comes five times a second; older than this, it says nothing about now. */
export const MISSION_STALE_MS = 3000;
