/** MessagePack, as much of it as the messages of the link need. */

const DEEPEST = 16;
const LONGEST_BYTES = 4096;
const SAFE = BigInt(Number.MAX_SAFE_INTEGER);

/** @typedef {number | bigint} Whole a bigint where a number would not be exact */

/**
 * The bytes of a value: null, truth, number, bigint, text, bytes, arrays and objects of these.
 *
 * A number that is whole is written as one: who reads it there knows whether it may have a
 * fraction. RangeError if there is no form for it, or more than fits into a message. @param
 * {unknown} value
 */
export function pack(value) {
  const bytes = new Uint8Array(LONGEST_BYTES);
  return bytes.slice(0, write(new DataView(bytes.buffer), 0, value));
}

/**
 *  Where what follows is written. @param {DataView} to @param {number} at @param {unknown} value
 * @returns {number}
 */
function write(to, at, value) {
  if (value === null || value === false || value === true) {
    to.setUint8(at, value === null ? 0xc0 : value ? 0xc3 : 0xc2);
    return at + 1;
  }
  if (typeof value === "number" && !Number.isSafeInteger(value)) {
    to.setUint8(at, 0xcb);
    to.setFloat64(at + 1, value);
    return at + 9;
  }
  if (typeof value === "number" && value >= 0 && value < 2 ** 32) {
    const isShort = value < 128;
    to.setUint8(at, isShort ? value : 0xce);
    if (!isShort) to.setUint32(at + 1, value);
    return at + (isShort ? 1 : 5);
  }
  if (typeof value === "number" || typeof value === "bigint") {
    to.setUint8(at, value < 0 ? 0xd3 : 0xcf);
    to.setBigInt64(at + 1, BigInt(value)); // the same bits, signed or not
    return at + 9;
  }
  if (Array.isArray(value)) {
    to.setUint8(at, 0xdc);
    to.setUint16(at + 1, value.length);
    return value.reduce((place, one) => write(to, place, one), at + 3);
  }
  if (typeof value === "object" && !(value instanceof Uint8Array)) {
    const entries = Object.entries(value);
    to.setUint8(at, 0xde);
    to.setUint16(at + 1, entries.length);
    return entries.reduce((place, [key, one]) => write(to, write(to, place, key), one), at + 3);
  }
  if (typeof value !== "string" && !(value instanceof Uint8Array)) throw new RangeError(`${value}`);
  const bytes = typeof value === "string" ? new TextEncoder().encode(value) : value;
  to.setUint8(at, typeof value === "string" ? 0xda : 0xc5);
  to.setUint16(at + 1, bytes.length);
  new Uint8Array(to.buffer).set(bytes, at + 3);
  return at + 3 + bytes.length;
}

/**
 * The one value that the bytes are; RangeError if they are none.
 *
 * Maps become objects without a prototype. Whole numbers beyond what a number keeps become bigints.
 * @param {Uint8Array} bytes @returns {any}
 */
export function unpack(bytes) {
  const reader = new Reader(bytes);
  const value = reader.value(0);
  if (!reader.isAtEnd) throw new RangeError("bytes follow the value");
  return value;
}

class Reader {
  #bytes;
  #view;
  #at = 0;

  /** @param {Uint8Array} bytes */
  constructor(bytes) {
    this.#bytes = bytes;
    this.#view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  }

  get isAtEnd() {
    return this.#at === this.#bytes.length;
  }

  /** @param {number} depth @returns {any} */
  value(depth) {
    if (depth > DEEPEST) throw new RangeError("nested too deeply");
    const first = this.#size(0);
    if (first < 0x80) return first;
    if (first < 0x90) return this.#map(first & 0x0f, depth);
    if (first < 0xa0) return this.#array(first & 0x0f, depth);
    if (first < 0xc0) return this.#text(first & 0x1f);
    if (first >= 0xe0) return first - 0x100;
    if (first === 0xc0) return null;
    if (first === 0xc2 || first === 0xc3) return first === 0xc3;
    if (first >= 0xc4 && first <= 0xc6) return this.#raw(this.#size(first - 0xc4)).slice();
    if (first === 0xca) return this.#view.getFloat32(this.#take(4));
    if (first === 0xcb) return this.#view.getFloat64(this.#take(8));
    if (first >= 0xcc && first <= 0xce) return this.#size(first - 0xcc);
    if (first === 0xcf) return plain(this.#view.getBigUint64(this.#take(8)));
    if (first === 0xd0) return this.#view.getInt8(this.#take(1));
    if (first === 0xd1) return this.#view.getInt16(this.#take(2));
    if (first === 0xd2) return this.#view.getInt32(this.#take(4));
    if (first === 0xd3) return plain(this.#view.getBigInt64(this.#take(8)));
    if (first >= 0xd9 && first <= 0xdb) return this.#text(this.#size(first - 0xd9));
    if (first === 0xdc || first === 0xdd) return this.#array(this.#size(first - 0xdb), depth);
    if (first === 0xde || first === 0xdf) return this.#map(this.#size(first - 0xdd), depth);
    throw new RangeError(`no value begins with ${first}`);
  }

  /** A number of one, two or four bytes. @param {number} exponent 0, 1 or 2 */
  #size(exponent) {
    const at = this.#take(1 << exponent);
    if (exponent === 0) return this.#view.getUint8(at);
    return exponent === 1 ? this.#view.getUint16(at) : this.#view.getUint32(at);
  }

  /** @param {number} length @param {number} depth */
  #array(length, depth) {
    const values = [];
    for (let place = 0; place < length; place++) values.push(this.value(depth + 1));
    return values;
  }

  /** @param {number} length @param {number} depth */
  #map(length, depth) {
    const found = Object.create(null);
    for (let place = 0; place < length; place++) {
      const key = String(this.value(depth + 1));
      found[key] = this.value(depth + 1);
    }
    return found;
  }

  /** @param {number} length */
  #text(length) {
    try {
      return new TextDecoder("utf-8", { fatal: true }).decode(this.#raw(length));
    } catch (error) {
      throw new RangeError("no text", { cause: error });
    }
  }

  /** @param {number} length */
  #raw(length) {
    const at = this.#take(length);
    return this.#bytes.subarray(at, at + length);
  }

  /** @param {number} size */
  #take(size) {
    const at = this.#at;
    if (at + size > this.#bytes.length) throw new RangeError("the bytes end too early");
    this.#at += size;
    return at;
  }
}

/** @param {bigint} value */
function plain(value) {
  return value <= SAFE && value >= -SAFE ? Number(value) : value;
}
