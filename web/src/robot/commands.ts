/** Publications and service calls of this page, each only where the page may send it now. */
import type { MessageTypes, ServiceTypes } from "@/generated/messages";
import { CommandRefused, refuseCommand } from "@/safety/guard";
import { notePublication } from "@/state/publish_log";
import { link } from "./link";
import { gate } from "./stop";

/** A row of the graph's tables. */
interface Row<Type> {
  readonly name: string;
  readonly type: Type;
  readonly console?: string;
  readonly moves: boolean;
}

/** Throws CommandRefused where this page may not send a command now: what can lead to motion waits until its gate was opened. */
export function checkCommand(row: Pick<Row<string>, "console" | "moves">): void {
  refuseCommand(row);
  if (row.moves && gate.engaged) throw new CommandRefused(gate.isStated ? "command_while_stopped" : "command_while_closed");
}

/** Publish on a topic of the graph; returns false where the link is down. Throws CommandRefused. */
export function publish<Type extends keyof MessageTypes>(row: Row<Type>, message: Partial<MessageTypes[Type]>): boolean {
  checkCommand(row);
  const sent = link.publish(row.name, row.type, message);
  notePublication(row.name, message, sent);
  return sent;
}

/** Call a service of the graph. Rejects with LinkLost, CallFailed or CommandRefused. */
export async function call<Type extends keyof ServiceTypes>(
  row: Row<Type>,
  request: Partial<ServiceTypes[Type]["request"]>,
  timeoutMs?: number,
): Promise<ServiceTypes[Type]["response"]> {
  checkCommand(row);
  // What every client may call only reads, and is called all the time.
  if (row.console !== "viewer") notePublication(row.name, request, link.isOpen);
  return (await link.call(row.name, row.type, request, timeoutMs)) as ServiceTypes[Type]["response"];
}
