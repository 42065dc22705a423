import { describe, expect, it } from "vitest";
import { isLocalHost, qrPath } from "./qr_path";

describe("the QR code", () => {
  it("has a square for every dark module within a quiet zone", () => {
    expect(qrPath(2, (row, column) => row === column)).toEqual({ path: "M4 4h1v1h-1zM5 5h1v1h-1z", size: 10 });
  });

  it("is of no use for other devices on an address of this computer only", () => {
    expect(["localhost", "127.0.0.1", "[::1]"].every(isLocalHost)).toBe(true);
    expect(["192.168.42.20", "laptop.local"].some(isLocalHost)).toBe(false);
  });
});
