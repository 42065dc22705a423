/** Pairing this browser with the console's server. */
import { socketUrl } from "@/environment";
import { followServer } from "./events";
import { postJson } from "./http";

/** Pair this browser by a code, then follow the server. Throws ApiError with the reason. */
export async function pair(code: string): Promise<void> {
  await postJson("/_api/pair", { code });
  await followServer(socketUrl("/_api/events"));
}

/** Take the pairing code, which a QR code puts there, out of the address, so that it stays neither visible nor in the history. */
export function takeScannedCode(): string | null {
  const scanned = new URLSearchParams(location.hash.slice(1)).get("code");
  if (scanned !== null) history.replaceState(null, "", location.pathname);
  return scanned;
}
