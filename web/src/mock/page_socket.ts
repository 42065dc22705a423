/** A socket whose server is in the page. */
import type { MessageSocket } from "@/api/sockets";

const OPENS_AFTER_MS = 40;
const ANSWERS_AFTER_MS = 5;

/** The server's end: what a client sends, and the end of its connection. */
export interface PageServer {
  opened(): void;
  received(text: string): void;
  closed(): void;
}

export class PageSocket implements MessageSocket {
  binaryType = "";
  readonly bufferedAmount = 0;
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onclose: ((event: { code: number; reason: string }) => void) | null = null;
  private isOpen = false;
  private isClosed = false;
  private readonly end: PageServer;

  constructor(serve: (socket: PageSocket) => PageServer) {
    this.end = serve(this);
    setTimeout(() => {
      if (this.isClosed) return;
      this.isOpen = true;
      this.onopen?.();
      this.end.opened();
    }, OPENS_AFTER_MS);
  }

  /** Sound is dropped: no server of the page hears it. */
  send(data: string | ArrayBuffer): void {
    if (!this.isOpen) throw new Error("the socket is not open");
    if (typeof data === "string") setTimeout(() => !this.isClosed && this.end.received(data), ANSWERS_AFTER_MS);
  }

  /** Send to the client. */
  deliver(message: unknown): void {
    if (this.isOpen) this.onmessage?.({ data: JSON.stringify(message) });
  }

  close(): void {
    this.closeWith(1005, "");
  }

  /** Close from the server's end. */
  closeWith(code: number, reason: string): void {
    if (this.isClosed) return;
    this.isClosed = true;
    this.isOpen = false;
    this.end.closed();
    this.onclose?.({ code, reason });
  }
}
