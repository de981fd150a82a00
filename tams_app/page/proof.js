/**
 * What is said over the first stream: the robot challenges, the page proves its code.
 *
 * As in `tams_app/link/proof.py`, with a code in the place of a key. The robot proves in its
 * welcome that it knows the code as well.
 */

import { pack, unpack } from "./msgpack.js";

const [NONCE_BYTES, HASH_BYTES, NAME_BYTES, CODE_BYTES] = [32, 32, 8, 16];
const LONGEST_INTRODUCTION_BYTES = 256;

/**
 * The robot as it is known before a call: SHA-256 of its certificate, and the key that signed it.
 * @typedef {{ certificate: Uint8Array, identity: Uint8Array }} Door
 *
 * `again` is the code with which this tab comes back; empty: the same one.
 * @typedef {{ description: Uint8Array, again: Uint8Array }} Welcome
 * @typedef {{ next: () => Promise<Uint8Array>, say: (message: Uint8Array) => Promise<void> }} Stream
 */

/**
 * Proves the code; null: the robot is busy. RangeError if it does not know the code.
 * @param {Uint8Array} code @param {Door} door @param {string} introduction
 *   `LONGEST_INTRODUCTION_BYTES` at most
 * @param {Stream} stream @returns {Promise<Welcome | null>}
 */
export async function prove(code, { identity, certificate }, introduction, stream) {
  const hmac = { name: "HMAC", hash: "SHA-256" };
  const key = await crypto.subtle.importKey("raw", joined(code), hmac, false, ["sign"]);
  const mac = async (/** @type {Uint8Array[]} */ ...parts) =>
    new Uint8Array(await crypto.subtle.sign("HMAC", key, joined(...parts)));
  const challenge = unpack(await stream.next());
  const theirs = challenge?.nonce;
  if (!isBytes(theirs, NONCE_BYTES)) throw new RangeError("no challenge");
  const ours = crypto.getRandomValues(new Uint8Array(NONCE_BYTES));
  const about = [identity, certificate, theirs, ours];
  const name = (await mac(text("TAMS page name"))).slice(0, NAME_BYTES);
  const told = filled(text(introduction), LONGEST_INTRODUCTION_BYTES);
  const proof = await mac(text("TAMS operator"), ...about, told);
  await stream.say(pack({ type: "Proof", key: name, nonce: ours, mac: proof, introduction: told }));
  const { type, content, mac: theirMac, again = new Uint8Array() } = unpack(await stream.next());
  if (type === "Busy") return null;
  if (type !== "Welcome" || !isBytes(content) || !isBytes(again)) throw new RangeError(type);
  const expected = await mac(text("TAMS robot"), ...about, content);
  if (!isBytes(theirMac, HASH_BYTES) || !same(theirMac, expected)) throw new RangeError(type);
  return { description: content.slice(2, 2 + lengthOf(content)), again };
}

/** The messages of a stream, put together from its pieces. */
export class StreamMessages {
  #reader;
  #bytes = new Uint8Array();

  /** @param {ReadableStream<Uint8Array>} stream */
  constructor(stream) {
    this.#reader = stream.getReader();
  }

  /** The next one; RangeError if the stream ends before. */
  async next() {
    for (;;) {
      const end = 2 + lengthOf(this.#bytes);
      if (this.#bytes.length >= end) {
        const message = this.#bytes.slice(2, end);
        this.#bytes = this.#bytes.slice(end);
        return message;
      }
      const { value, done } = await this.#reader.read();
      if (done) throw new RangeError("the stream has ended");
      this.#bytes = joined(this.#bytes, value);
    }
  }
}

/** A message with its length before it. @param {Uint8Array} message */
export function prefixed(message) {
  return joined(Uint8Array.of(message.length >> 8, message.length & 0xff), message);
}

/**
 * The parts of a link's fragment, `#CODE` or `#CODE.CERTIFICATE` in base64url; null: it is none.
 * @param {string} fragment @returns {{ code: Uint8Array, certificate: Uint8Array | null } | null}
 */
export function readFragment(fragment) {
  const [code, certificate] = fragment.replace(/^#/, "").split(".").map(fromBase64);
  if (!isBytes(code, CODE_BYTES)) return null;
  return { code, certificate: isBytes(certificate, HASH_BYTES) ? certificate : null };
}

/** Base64, or its form for URLs; empty if it is neither. @param {string} encoded */
export function fromBase64(encoded) {
  try {
    const plain = atob(encoded.replaceAll("-", "+").replaceAll("_", "/"));
    return Uint8Array.from(plain, (character) => character.charCodeAt(0));
  } catch {
    return new Uint8Array();
  }
}

/**
 *  Content with its length before it, and zeros behind. @param {Uint8Array} content @param {number}
 * size
 */
function filled(content, size) {
  return joined(prefixed(content), new Uint8Array(size - content.length));
}

/** What the first two bytes say. @param {Uint8Array} content */
function lengthOf([high = 0, low = 0]) {
  return 256 * high + low;
}

/** @param {string} value */
function text(value) {
  return new TextEncoder().encode(value);
}

/** @param {Uint8Array[]} parts */
function joined(...parts) {
  const found = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    found.set(part, at);
    at += part.length;
  }
  return found;
}

/** @param {unknown} value @param {number} [length] @returns {value is Uint8Array} */
function isBytes(value, length) {
  return value instanceof Uint8Array && (length === undefined || value.length === length);
}

/** Takes equally long wherever they differ. @param {Uint8Array} one @param {Uint8Array} other */
function same(one, other) {
  return one.reduce((all, byte, place) => all | (byte ^ (other[place] ?? 0)), 0) === 0;
}
