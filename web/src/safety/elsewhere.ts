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
