/** A QR code as the path of an SVG. */

const QUIET_ZONE = 4;

/** One unit square for every dark module, in a square of `size` units with the quiet zone that readers need. */
export function qrPath(modules: number, isDark: (row: number, column: number) => boolean): { path: string; size: number } {
  let path = "";
  for (let row = 0; row < modules; row += 1) {
    for (let column = 0; column < modules; column += 1) {
      if (isDark(row, column)) path += `M${column + QUIET_ZONE} ${row + QUIET_ZONE}h1v1h-1z`;
    }
  }
  return { path, size: modules + 2 * QUIET_ZONE };
}

/** Whether another device that opens this host name would reach itself, as with localhost. */
export function isLocalHost(name: string): boolean {
  return name === "localhost" || name.endsWith(".localhost") || name.startsWith("127.") || name === "[::1]";
}
