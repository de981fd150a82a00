/**
 * Parity of a frame's packets: any one packet lost of a group is restored bit for bit.
 *
 * As in `tams_app/video/core/parity.py`, which makes them and says how.
 */

import { SEQUENCES, dataView } from "./rtp.js";

/** @typedef {import("./rtp.js").RtpPacket} RtpPacket */

// First sequence number (16 bits), packets, distance between their numbers, markers, length (16).
const GROUP_BYTES = 7;
const KEPT_PACKETS = 1024;
const KEPT_WAITING = 64;

/** Restores the lost packets of one view; takes packets in any order, also twice or never. */
export class ParityDecoder {
  /** @type {Map<number, RtpPacket>} by `keyOf` */
  #media = new Map();
  /** @type {Map<number, RtpPacket>} parity with two or more missing, by each of these */
  #waiting = new Map();
  #ssrc;

  /** @param {number} mediaSsrc */
  constructor(mediaSsrc) {
    this.#ssrc = mediaSsrc;
  }

  /** A media packet came: what it lets earlier parity restore. @param {RtpPacket} packet */
  media(packet) {
    const key = keyOf(packet.timestamp, packet.sequence);
    keep(this.#media, key, packet, KEPT_PACKETS);
    const waiting = this.#waiting.get(key);
    this.#waiting.delete(key);
    return waiting === undefined ? [] : this.parity(waiting);
  }

  /**
   * A parity packet came: the packet that it restores, if exactly one of its group misses.
   * @param {RtpPacket} packet @returns {RtpPacket[]}
   */
  parity(packet) {
    const { payload, timestamp } = packet;
    if (payload.length < GROUP_BYTES) return [];
    const group = dataView(payload);
    let markers = group.getUint8(4);
    let length = group.getUint16(5);
    const missing = [];
    const parts = [payload.subarray(GROUP_BYTES)];
    for (let place = 0; place < group.getUint8(2); place++) {
      const sequence = (group.getUint16(0) + place * group.getUint8(3)) % SEQUENCES;
      const known = this.#media.get(keyOf(timestamp, sequence));
      if (known === undefined) {
        missing.push(sequence);
      } else {
        parts.push(known.payload);
        markers ^= Number(known.marker);
        length ^= known.payload.length;
      }
    }
    const [sequence, ...more] = missing;
    if (sequence === undefined) return [];
    if (more.length > 0) {
      for (const one of missing) keep(this.#waiting, keyOf(timestamp, one), packet, KEPT_WAITING);
      return [];
    }
    const content = xor(parts);
    if (length > content.length) return []; // no packet of ours
    const restored = {
      marker: (markers & 1) !== 0,
      sequence,
      timestamp,
      ssrc: this.#ssrc,
      transportSequence: null,
      payload: content.subarray(0, length),
    };
    keep(this.#media, keyOf(timestamp, sequence), restored, KEPT_PACKETS);
    return [restored];
  }
}

/** @param {number} timestamp @param {number} sequence */
function keyOf(timestamp, sequence) {
  return timestamp * SEQUENCES + sequence; // 48 bits: exact
}

/**
 * @param {Map<number, RtpPacket>} kept @param {number} key @param {RtpPacket} packet
 * @param {number} most
 */
function keep(kept, key, packet, most) {
  kept.set(key, packet);
  const [oldest] = kept.keys();
  if (kept.size > most && oldest !== undefined) kept.delete(oldest);
}

/** The XOR of all, as long as the longest. @param {Uint8Array[]} parts */
function xor(parts) {
  const sum = new Uint8Array(Math.max(...parts.map((part) => part.length)));
  for (const part of parts) part.forEach((byte, at) => (sum[at] = (sum[at] ?? 0) ^ byte));
  return sum;
}
