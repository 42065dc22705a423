import { describe, expect, it } from "vitest";
import { MalformedStream, PartReader } from "./multipart";

const text = new TextEncoder();

function stream(...images: { jpeg: number[]; stamp?: string }[]): Uint8Array {
  const bytes = [...text.encode("--lupin-frame\r\n")];
  for (const { jpeg, stamp } of images) {
    const head = `Content-Type: image/jpeg\r\n${stamp === undefined ? "" : `X-Timestamp: ${stamp}\r\n`}Content-Length: ${jpeg.length}\r\n\r\n`;
    for (const each of [...text.encode(head), ...jpeg, ...text.encode("\r\n--lupin-frame\r\n")]) bytes.push(each);
  }
  return Uint8Array.from(bytes);
}

describe("the multipart stream", () => {
  it("gives images with their stamps, however it is cut", () => {
    // The image holds what looks like the end of a header.
    const whole = stream({ jpeg: [1, 13, 10, 13, 10, 2], stamp: "407.250000000" }, { jpeg: [7] });
    for (const size of [1, 3, 16, whole.length]) {
      const reader = new PartReader();
      const found = [];
      for (let at = 0; at < whole.length; at += size) found.push(...reader.feed(whole.subarray(at, at + size)));
      expect(found.map(({ jpeg, stampS }) => ({ jpeg: [...jpeg], stampS }))).toEqual([
        { jpeg: [1, 13, 10, 13, 10, 2], stampS: 407.25 },
        { jpeg: [7], stampS: null },
      ]);
    }
  });

  it("grows with large images", () => {
    const jpeg = Array.from({ length: 300_000 }, (_, index) => index % 251);
    const [image] = new PartReader().feed(stream({ jpeg }));
    expect(image?.jpeg.length).toBe(jpeg.length);
  });

  it("refuses what is no such stream", () => {
    expect(() => new PartReader().feed(text.encode("Content-Length: many\r\n\r\n"))).toThrow(MalformedStream);
    expect(() => new PartReader().feed(text.encode("x".repeat(3000)))).toThrow(MalformedStream);
  });
});
