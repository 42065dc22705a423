/** The tabs by the names that the page's address has, in their order. */
export const TAB_IDS = ["teleop", "arm", "voice", "cameras", "telemetry", "logs", "map"] as const;

export type TabId = (typeof TAB_IDS)[number];
