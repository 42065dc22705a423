/**
 * A page that was told to show the robot behind another rosbridge than its console's. Control, releases and the journal are the
 * console's, so such a page watches and stops, and commands nothing.
 */

let address: string | null = null;

/** Note which rosbridge this page uses, where it is not its console's: once, before it connects. */
export function goElsewhere(url: string | null): void {
  address = url;
}

/** The address of the other rosbridge; null where the page uses its console's. */
export function elsewhere(): string | null {
  return address;
}

const RETRY_MS = 1000;

/** States the stop of such a page to its console, until the console has answered or there is something newer to state. */
export class StopOfConsole {
  /** What was stated last of each press: a press that somebody else released is followed by another. */
  private readonly stated = new Map<string, { engaged: boolean }>();

  constructor(private readonly post: (body: unknown) => Promise<unknown>) {}

  state(engaged: boolean, press: string): void {
    if (this.stated.get(press)?.engaged === engaged) return;
    const statement = { engaged };
    this.stated.set(press, statement);
    this.send(press, statement);
  }

  private send(press: string, statement: { engaged: boolean }): void {
    const body = statement.engaged ? { engaged: true, press } : { engaged: false, presses: [press] };
    this.post(body).catch(() => {
      setTimeout(() => {
        if (this.stated.get(press) === statement) this.send(press, statement);
      }, RETRY_MS);
    });
  }
}
