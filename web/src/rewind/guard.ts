/**
 * What may be sent while the page shows the past, where nobody sees what a command would do, and while another tab of this
 * browser commands.
 */
import { TextError } from "@/i18n/text_error";
import { isWatching } from "@/safety/commanding_tab";
import { isRewound } from "./state";

/** Requests that command nothing, and the stop. */
const ALLOWED: readonly ((path: string, body: Record<string, unknown>) => boolean)[] = [
  (path, { engaged }) => path === "/_api/stop" && engaged === true,
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
  return isRewound() ? new CommandRefused("rewind_no_command") : isWatching() ? new CommandRefused("other_tab_no_command") : null;
}
