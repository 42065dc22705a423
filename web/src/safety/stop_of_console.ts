/** The stop of a page that shows another robot, at its own console. */
import { ApiError } from "@/api/http";

const RETRY_MS = 1000;

/** States the stop of such a page to its console, until the console has answered or there is something newer to state. */
export class StopOfConsole {
  /** What was stated last of each press: a press that somebody else released is followed by another. */
  private readonly stated = new Map<string, { engaged: boolean }>();
  /** Of each press, the end of what was sent last. */
  private readonly sent = new Map<string, Promise<void>>();

  /** `refused` gets the error of a request that the console refused. Such a request is not repeated. */
  constructor(
    private readonly post: (body: unknown) => Promise<unknown>,
    private readonly refused: (error: unknown) => void,
  ) {}

  state(engaged: boolean, press: string): void {
    if (this.stated.get(press)?.engaged === engaged) return;
    const statement = { engaged };
    this.stated.set(press, statement);
    // In order: a withdrawal that overtook its stop would leave that engaged.
    this.sent.set(press, (this.sent.get(press) ?? Promise.resolve()).then(() => this.send(press, statement)));
  }

  private async send(press: string, statement: { engaged: boolean }): Promise<void> {
    do {
      try {
        await this.post({ ...statement, press });
        return;
      } catch (error) {
        if (error instanceof ApiError && error.status >= 400 && error.status < 500) {
          this.refused(error);
          return;
        }
      }
      await new Promise((resolve) => void setTimeout(resolve, RETRY_MS));
    } while (this.stated.get(press) === statement);
  }
}
