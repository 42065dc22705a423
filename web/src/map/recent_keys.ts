/** Notices what comes again, such as latched observations after a reconnect. Keeps the newest keys only: a page is open for days. */
export class RecentKeys {
  private readonly keys = new Set<string>();

  constructor(private readonly limit: number) {}

  get size(): number {
    return this.keys.size;
  }

  /** Add a key; returns whether it is new. */
  add(key: string): boolean {
    const isNew = !this.keys.delete(key);
    this.keys.add(key);
    const [oldest] = this.keys;
    if (this.keys.size > this.limit && oldest !== undefined) this.keys.delete(oldest);
    return isNew;
  }
}
