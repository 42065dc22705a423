/** Where the page was opened from, and what its address asks for. */

const query = new URLSearchParams(location.search);

/** Whether the page runs with a mock robot: `?mock=1`. */
export const IS_MOCK = query.get("mock") === "1";

/** The WebSocket address of a path of this origin. */
export function socketUrl(path: string): string {
  return `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${path}`;
}

/**
 * The address of rosbridge: this origin's, or the one that `?ros=` names. On an HTTPS page a ws:// address is passed over, as
 * the browser would refuse it.
 */
export function rosbridgeUrl(asked: string | null = query.get("ros")): string {
  const own = socketUrl("/_ros");
  if (asked === null || !/^wss?:\/\//.test(asked)) return own;
  if (location.protocol === "https:" && asked.startsWith("ws:")) return own;
  return asked;
}
