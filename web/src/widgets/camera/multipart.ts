/** Splits a `multipart/x-mixed-replace` stream of the video server into its images. */

export interface JpegPart {
  jpeg: Uint8Array<ArrayBuffer>;
  /** When the camera took the image, s of ROS time; null where the stream does not say. */
  stampS: number | null;
}

/** The data is not a stream in this format. */
export class MalformedStream extends Error {}

const MAX_IMAGE_BYTES = 16_000_000;
const MAX_HEADER_BYTES = 2000;

export class PartReader {
  private data = new Uint8Array(1 << 17);
  private length = 0;
  private expected: { bytes: number; stampS: number | null } | null = null;

  /** Add a chunk; returns the images that are complete with it. Throws MalformedStream. */
  feed(chunk: Uint8Array): JpegPart[] {
    this.append(chunk);
    const parts: JpegPart[] = [];
    for (;;) {
      if (this.expected === null) {
        const end = this.headerEnd();
        if (end < 0) {
          if (this.length > MAX_HEADER_BYTES) throw new MalformedStream("an image's header has no end");
          return parts;
        }
        this.expected = readHeader(this.data.subarray(0, end));
        this.remove(end + 4);
      }
      const { bytes, stampS } = this.expected;
      if (this.length < bytes) return parts;
      parts.push({ jpeg: this.data.slice(0, bytes), stampS });
      this.remove(bytes);
      this.expected = null;
    }
  }

  private append(chunk: Uint8Array): void {
    if (this.length + chunk.length > this.data.length) {
      const larger = new Uint8Array(Math.max(2 * this.data.length, this.length + chunk.length));
      larger.set(this.data.subarray(0, this.length));
      this.data = larger;
    }
    this.data.set(chunk, this.length);
    this.length += chunk.length;
  }

  private remove(count: number): void {
    this.data.copyWithin(0, count, this.length);
    this.length -= count;
  }

  private headerEnd(): number {
    const { data } = this;
    for (let at = 0; at + 3 < this.length; at += 1) {
      if (data[at] === 13 && data[at + 1] === 10 && data[at + 2] === 13 && data[at + 3] === 10) return at;
    }
    return -1;
  }
}

function readHeader(bytes: Uint8Array): { bytes: number; stampS: number | null } {
  const fields = new Map<string, string>();
  for (const line of new TextDecoder("latin1").decode(bytes).split("\r\n")) {
    const colon = line.indexOf(":");
    if (colon > 0) fields.set(line.slice(0, colon).trim().toLowerCase(), line.slice(colon + 1).trim());
  }
  const length = fields.get("content-length") ?? "";
  if (!/^\d{1,9}$/.test(length) || Number(length) > MAX_IMAGE_BYTES) {
    throw new MalformedStream(`an image of '${length.slice(0, 20)}' bytes`);
  }
  const stamp = Number(fields.get("x-timestamp") ?? NaN);
  return { bytes: Number(length), stampS: Number.isFinite(stamp) && stamp > 0 ? stamp : null };
}
