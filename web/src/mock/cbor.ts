/** Writes CBOR as the console's server does: typed arrays by the tags of RFC 8746, in little endian. */

const TYPED_ARRAY_TAGS = new Map<unknown, number>([
  [Uint8Array, 64],
  [Int8Array, 72],
  [Uint16Array, 69],
  [Int16Array, 77],
  [Uint32Array, 70],
  [Int32Array, 78],
  [Float32Array, 85],
  [Float64Array, 86],
]);

const UNSIGNED = 0x00;
const NEGATIVE = 0x20;
const BYTES = 0x40;
const TEXT = 0x60;
const ARRAY = 0x80;
const MAP = 0xa0;
const TAG = 0xc0;
const FALSE = 0xf4;
const TRUE = 0xf5;
const NULL = 0xf6;
const FLOAT64 = 0xfb;

const texts = new TextEncoder();

/** The CBOR of a plain value: numbers, texts, booleans, null, arrays, typed arrays and objects of them. */
export function encodeCbor(value: unknown): ArrayBuffer {
  const writer = new Writer();
  writer.write(value);
  return writer.bytes();
}

class Writer {
  private buffer = new Uint8Array(1024);
  private view = new DataView(this.buffer.buffer);
  private length = 0;

  bytes(): ArrayBuffer {
    return this.buffer.slice(0, this.length).buffer;
  }

  write(value: unknown): void {
    if (typeof value === "number") this.number(value);
    else if (typeof value === "string") this.text(value);
    else if (value === true || value === false) this.byte(value ? TRUE : FALSE);
    else if (value === null || value === undefined) this.byte(NULL);
    else if (Array.isArray(value)) {
      this.head(ARRAY, value.length);
      for (const each of value) this.write(each);
    } else if (ArrayBuffer.isView(value)) this.typedArray(value);
    else this.object(value as Record<string, unknown>);
  }

  private object(value: Record<string, unknown>): void {
    const entries = Object.entries(value);
    this.head(MAP, entries.length);
    for (const [name, each] of entries) {
      this.text(name);
      this.write(each);
    }
  }

  private number(value: number): void {
    if (Number.isInteger(value) && Math.abs(value) < 2 ** 32 && !Object.is(value, -0)) {
      if (value >= 0) this.head(UNSIGNED, value);
      else this.head(NEGATIVE, -1 - value);
      return;
    }
    this.reserve(9);
    this.buffer[this.length] = FLOAT64;
    this.view.setFloat64(this.length + 1, value);
    this.length += 9;
  }

  private text(value: string): void {
    const bytes = texts.encode(value);
    this.head(TEXT, bytes.length);
    this.raw(bytes);
  }

  private typedArray(value: ArrayBufferView): void {
    const tag = TYPED_ARRAY_TAGS.get(value.constructor);
    if (tag === undefined) throw new TypeError(`${value.constructor.name} has no tag`);
    this.head(TAG, tag);
    this.head(BYTES, value.byteLength);
    this.raw(new Uint8Array(value.buffer, value.byteOffset, value.byteLength));
  }

  /** A head: the major type with an unsigned number. */
  private head(major: number, value: number): void {
    this.reserve(5);
    if (value < 24) this.byte(major | value);
    else if (value < 0x100) {
      this.byte(major | 24);
      this.byte(value);
    } else if (value < 0x10000) {
      this.byte(major | 25);
      this.view.setUint16(this.length, value);
      this.length += 2;
    } else {
      this.byte(major | 26);
      this.view.setUint32(this.length, value);
      this.length += 4;
    }
  }

  private byte(value: number): void {
    this.reserve(1);
    this.buffer[this.length] = value;
    this.length += 1;
  }

  private raw(bytes: Uint8Array): void {
    this.reserve(bytes.length);
    this.buffer.set(bytes, this.length);
    this.length += bytes.length;
  }

  private reserve(more: number): void {
    if (this.length + more <= this.buffer.length) return;
    const larger = new Uint8Array(Math.max(this.buffer.length * 2, this.length + more));
    larger.set(this.buffer);
    this.buffer = larger;
    this.view = new DataView(larger.buffer);
  }
}
