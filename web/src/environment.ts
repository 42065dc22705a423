/** Where the page was opened from, and what its address asks for. */

const query = new URLSearchParams(location.search);

/** Whether the page runs with a mock robot: `?mock=1`. */
export const IS_MOCK = query.get("mock") === "1";

/** The WebSocket address of a path of this origin. */
export function socketUrl(path: string): string {
  return `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${path}`;
}

/** The address of rosbridge that the page's own address asks for: `?ros=`; null where it asks for none. */
export const ROS_QUERY = query.get("ros");

/**
 * The address of rosbridge: this origin's, or the one that was asked for. What is no such address is passed over, and so is ws://
 * on an HTTPS page, as the browser would refuse it.
 */
export function rosbridgeUrl(asked: string | null): string {
  const own = socketUrl("/_ros");
  if (asked === null || !/^wss?:\/\//.test(asked) || !URL.canParse(asked)) return own;
  if (location.protocol === "https:" && asked.startsWith("ws:")) return own;
  return new URL(asked).href === new URL(own).href ? own : asked;
}
