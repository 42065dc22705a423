/** How another device opens this console. */
import type { Role } from "@/generated/robot";
import { isLocalHost } from "./qr_path";

/** The server's description of the way to it. */
export interface Access {
  /** The page's addresses for other devices, the best first. */
  urls: readonly string[];
  /** The code of each role, which pairs one browser; without them where this browser may not show any. */
  codes: Partial<Record<Role, string>>;
  serves_only_this_computer: boolean;
}

/** The addresses for other devices: this page's own first, which is known to work, unless it leads to this computer only. */
export function sharedUrls({ urls }: Pick<Access, "urls">, { origin, hostname }: Pick<Location, "origin" | "hostname">): string[] {
  return isLocalHost(hostname) ? [...urls] : [origin, ...urls.filter((url) => url !== origin)];
}

/** What the QR code says. The code is in the fragment, which browsers do not send, and which the page takes out of its address. */
export function pairingUrl(url: string, code: string | undefined): string {
  return code === undefined ? `${url}/` : `${url}/#code=${code.replaceAll("-", "")}`;
}
