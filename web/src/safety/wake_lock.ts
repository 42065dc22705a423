/** Keeps the screen on while this page commands the robot: one that falls asleep would stop it. */

type WakeLockLike = Pick<Navigator, "wakeLock">["wakeLock"] | undefined;

export class ScreenOn {
  private wanted = false;
  private lock: WakeLockSentinel | null = null;
  private isAsking = false;

  /** Browsers know no wake lock over plain HTTP, and refuse it where the battery is low: then nothing changes. */
  constructor(private readonly wakeLock: WakeLockLike = navigator.wakeLock) {}

  want(wanted: boolean): void {
    this.wanted = wanted;
    if (wanted) void this.ask();
    else void this.end();
  }

  /** The browser ends the lock of a page that is hidden. */
  shownAgain(): void {
    if (this.wanted) void this.ask();
  }

  private async ask(): Promise<void> {
    if (this.wakeLock === undefined || this.isAsking || this.lock?.released === false) return;
    this.isAsking = true;
    this.lock = await this.wakeLock.request("screen").catch(() => null);
    this.isAsking = false;
    if (!this.wanted) await this.end();
  }

  private async end(): Promise<void> {
    const { lock } = this;
    this.lock = null;
    await lock?.release().catch(() => {});
  }
}
