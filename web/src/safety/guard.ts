/**
 * What may be sent while the page shows the past, where nobody sees what a command would do, and while another tab of this
 * browser commands, or it shows another robot than its console's.
 */
import { TextError } from "@/i18n/text_error";
import { isWatching } from "@/safety/commanding_tab";
import { elsewhere } from "@/safety/elsewhere";
import { isOwnPress } from "@/safety/stop_gate";
import { isRewound } from "@/state/rewind";

/** Requests that command nothing, the stop, and what takes back a stop of this page alone. */
const ALLOWED: readonly ((path: string, body: Record<string, unknown>) => boolean)[] = [
  (path, { engaged, press }) => path === "/_api/stop" && (engaged === true || isOwnPress(press)),
  (path, { action }) => path === "/_api/lease" && ["grant", "refuse", "give_up"].includes(String(action)),
  (path) => path === "/_api/doctor/examination" || path === "/_api/pair",
];

/** A command that this page may not give now; the text says why. */
export class CommandRefused extends TextError {}

/** Throws CommandRefused where a POST to the console's server would be more than this page may send now. */
export function refuseRequest(path: string, body: unknown): void {
  const refusal = currentRefusal();
  if (refusal === null) return;
  const fields = typeof body === "object" && body !== null ? (body as Record<string, unknown>) : {};
  if (!ALLOWED.some((isAllowed) => isAllowed(path, fields))) throw refusal;
}

/** Throws CommandRefused where this page may not command now, and `row` of the graph is not one that every client may use. */
export function refuseCommand(row: { readonly console?: string }): void {
  const refusal = currentRefusal();
  if (refusal !== null && row.console !== "viewer") throw refusal;
}

function currentRefusal(): CommandRefused | null {
  if (elsewhere() !== null) return new CommandRefused("elsewhere_no_command");
  return isRewound() ? new CommandRefused("rewind_no_command") : isWatching() ? new CommandRefused("other_tab_no_command") : null;
}
