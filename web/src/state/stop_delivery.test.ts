import { describe, expect, it } from "vitest";
import { CONFIRMED_WITHIN_MS, type DeliveryFacts, stopDelivery } from "./stop_delivery";

const READY: DeliveryFacts = { linkOpen: true, robotStopped: false, serverStops: false, isStated: false, wasSent: false, ageMs: null };
const PRESSED: DeliveryFacts = { ...READY, isStated: true, wasSent: true, ageMs: 100 };

describe("the stop", () => {
  it("is sent, and stopped once the robot says so", () => {
    expect(stopDelivery(READY)).toBe("ready");
    expect(stopDelivery(PRESSED)).toBe("sent");
    expect(stopDelivery({ ...PRESSED, serverStops: true })).toBe("sent");
    expect(stopDelivery({ ...PRESSED, robotStopped: true })).toBe("stopped");
  });

  it("is not sent without a link, until the server has answered another way", () => {
    const lost = { ...PRESSED, linkOpen: false, robotStopped: null, wasSent: false };
    expect(stopDelivery(lost)).toBe("unsent");
    expect(stopDelivery({ ...lost, wasSent: true })).toBe("sent");
  });

  it("is unconfirmed where the robot confirms nothing", () => {
    expect(stopDelivery({ ...PRESSED, ageMs: CONFIRMED_WITHIN_MS + 1 })).toBe("unconfirmed");
    expect(stopDelivery({ ...PRESSED, robotStopped: null, serverStops: true, ageMs: 10_000 })).toBe("unconfirmed");
  });

  it("of others is sent until the robot confirms it", () => {
    expect(stopDelivery({ ...READY, serverStops: true })).toBe("sent");
    expect(stopDelivery({ ...READY, serverStops: true, linkOpen: false })).toBe("ready");
  });
});
