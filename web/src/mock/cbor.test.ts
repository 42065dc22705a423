import { decode } from "cbor2";
import { describe, expect, it } from "vitest";
import { encodeCbor } from "./cbor";

function roundTrip(value: unknown): unknown {
  return decode(new Uint8Array(encodeCbor(value)));
}

describe("CBOR of the mock mode", () => {
  it("is read back by the client's decoder", () => {
    const value = {
      text: "tag 19, 21 °C",
      flags: [true, false, null],
      numbers: [0, 23, 24, 255, 256, 65_536, 4_294_967_295, -1, -24, -25, -300, 0.5, -2.25, 1e300, 1_795_600_000.25],
      nested: { empty: {}, list: [] },
    };
    expect(roundTrip(value)).toEqual(value);
  });

  it("keeps typed arrays and their NaN", () => {
    for (const array of [Float32Array.of(1, NaN, -2), Float64Array.of(0.1, Infinity), Int8Array.of(-1, 0, 100), Int32Array.of(-70_000), Uint8Array.of(255)]) {
      expect(roundTrip({ array })).toEqual({ array });
    }
    expect(roundTrip([NaN, -0])).toEqual([NaN, -0]);
  });

  it("grows with long arrays", () => {
    const data = new Int8Array(32_000).fill(-1);
    expect(roundTrip({ data })).toEqual({ data });
  });
});
