/** The four milestones of a start, each of which is a real event. */
import type { TextKey } from "@/i18n/text";

export const INSTRUMENTS = ["odometry", "lidar", "battery", "joints", "estop"] as const;
export type Instrument = (typeof INSTRUMENTS)[number];

/** The instruments that suffice for the milestone `telemetry`; the rest follow. */
const FIRST: readonly Instrument[] = ["odometry", "battery"];

export interface BootFacts {
  /** performance.now() of the link's opening; null while it is not open. */
  linkMs: number | null;
  roundTripMs: number | null;
  /** The instruments that have sent data, with performance.now() of the first message. */
  heard: ReadonlyMap<Instrument, number>;
}

export type MilestoneName = "link" | "handshake" | "telemetry" | "live";

export interface Milestone {
  name: MilestoneName;
  reached: boolean;
  /** performance.now() of the event that reached it; null before. */
  atMs: number | null;
  detail: TextKey;
  values?: { ms: number };
  /** The instruments that `detail` names. */
  instruments?: Instrument[];
}

/** The milestones in their order; one counts only after those before it. */
export function milestones({ linkMs, roundTripMs, heard }: BootFacts): Milestone[] {
  const handshakeMs = linkMs === null || roundTripMs === null ? null : linkMs + roundTripMs;
  const missingFirst = FIRST.filter((instrument) => !heard.has(instrument));
  const telemetryMs = handshakeMs === null || missingFirst.length > 0 ? null : latest(handshakeMs, heard, FIRST);
  const missing = INSTRUMENTS.filter((instrument) => !heard.has(instrument));
  const liveMs = telemetryMs === null || missing.length > 0 ? null : latest(telemetryMs, heard, INSTRUMENTS);
  return [
    milestone("link", linkMs, { detail: linkMs === null ? "boot_link_waiting" : "boot_link_done" }),
    milestone("handshake", handshakeMs, {
      detail: handshakeMs === null ? "boot_handshake_waiting" : "boot_handshake_done",
      ...(roundTripMs === null ? {} : { values: { ms: Math.round(roundTripMs) } }),
    }),
    milestone("telemetry", telemetryMs, {
      detail: telemetryMs === null ? "boot_telemetry_waiting" : "boot_telemetry_done",
      instruments: telemetryMs === null ? missingFirst : [...FIRST],
    }),
    milestone("live", liveMs, {
      detail: liveMs !== null ? "boot_live_done" : telemetryMs === null ? "boot_live_waiting" : "boot_live_missing",
      ...(telemetryMs !== null && liveMs === null ? { instruments: missing } : {}),
    }),
  ];
}

function milestone(name: MilestoneName, atMs: number | null, rest: Omit<Milestone, "name" | "reached" | "atMs">): Milestone {
  return { name, reached: atMs !== null, atMs, ...rest };
}

function latest(afterMs: number, heard: ReadonlyMap<Instrument, number>, instruments: readonly Instrument[]): number {
  return Math.max(afterMs, ...instruments.map((instrument) => heard.get(instrument) ?? 0));
}

export function isLive(steps: readonly Milestone[]): boolean {
  return steps.every(({ reached }) => reached);
}
