/** WebSockets to the console's server and to the voice service. All but that of rosbridge are opened here. */

export interface MessageSocket {
  binaryType: string;
  onopen: (() => void) | null;
  onmessage: ((event: { data: unknown }) => void) | null;
  onclose: ((event: { code: number; reason: string }) => void) | null;
  /** Bytes that were sent, and that the network has not taken yet. */
  readonly bufferedAmount: number;
  send(data: string | ArrayBuffer): void;
  close(): void;
}

let open = (url: string): MessageSocket => new WebSocket(url) as unknown as MessageSocket;

/** Have something else than the network open all of them, as the mock mode does. */
export function openSocketsBy(other: (url: string) => MessageSocket): void {
  open = other;
}

export function openSocket(url: string): MessageSocket {
  return open(url);
}

export type OpenScriptedAgent = () => MessageSocket;

let loadScriptedAgent: (() => Promise<OpenScriptedAgent>) | null = null;

/** Offer a server within the page that speaks the protocol of the voice service, and follows a script. */
export function offerScriptedAgent(load: () => Promise<OpenScriptedAgent>): void {
  loadScriptedAgent = load;
}

/** A connection to the scripted agent; null where there is none. */
export async function openScriptedAgent(): Promise<MessageSocket | null> {
  return loadScriptedAgent === null ? null : (await loadScriptedAgent())();
}
