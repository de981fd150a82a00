/** H.264 from RTP packets (RFC 6184): single NAL units, STAP-A and FU-A, put together to frames. */

import { dataView } from "./rtp.js";

/** @typedef {import("./rtp.js").RtpPacket} RtpPacket */

/**
 * @typedef {object} Frame
 * @property {number} timestamp of RTP
 * @property {Uint8Array} data Annex B
 * @property {boolean} isKeyframe it has a slice of an IDR picture; parameter sets alone make none
 * @property {boolean} isComplete no packet of it is missing, as far as can be known
 */

const START_CODE = Uint8Array.of(0, 0, 0, 1);
const TYPE = 0x1f;
const [IDR, LAST_SINGLE, STAP_A, FU_A] = [5, 23, 24, 28];
const [FU_START, FU_END] = [0x80, 0x40];

/** Takes the packets of one view in order. */
export class Depacketizer {
  /** @type {number | null} of the frame that is being put together */
  #timestamp = null;
  /** @type {Uint8Array[]} */
  #parts = [];
  #isDamaged = false;
  #isKeyframe = false;
  #isInFragments = false; // between the first and the last fragment of a NAL unit

  /**
   * The frames that end here: what was left of one, and the one that the packet ends.
   * @param {RtpPacket} packet
   * @param {boolean} isAfterGap others before it are lost: of which frame is not known
   */
  add(packet, isAfterGap) {
    const frames = [];
    if (this.#timestamp !== null && this.#timestamp !== packet.timestamp) {
      frames.push(this.#finish(this.#timestamp, false));
    }
    this.#timestamp = packet.timestamp;
    if (isAfterGap) this.#damage();
    this.#take(packet.payload);
    if (packet.marker) {
      frames.push(this.#finish(packet.timestamp, true));
      this.#timestamp = null;
    }
    return frames;
  }

  /** @param {Uint8Array} payload */
  #take(payload) {
    const type = (payload[0] ?? 0) & TYPE;
    if (type === FU_A) return this.#fragment(payload);
    if (this.#isInFragments) this.#damage();
    if (type === STAP_A) return this.#aggregate(payload);
    return type >= 1 && type <= LAST_SINGLE ? this.#unit(payload) : this.#damage();
  }

  /** @param {Uint8Array} payload */
  #aggregate(payload) {
    const view = dataView(payload);
    for (let at = 1; at < payload.length; ) {
      const end = at + 2 <= payload.length ? at + 2 + view.getUint16(at) : Infinity;
      if (end > payload.length) return this.#damage();
      this.#unit(payload.subarray(at + 2, end));
      at = end;
    }
  }

  /** @param {Uint8Array} payload */
  #fragment(payload) {
    const [indicator = 0, header = 0] = payload;
    const isStart = (header & FU_START) !== 0;
    if (isStart === this.#isInFragments) this.#damage(); // the end of one, or the start, is missing
    if (isStart) this.#unit(Uint8Array.of((indicator & ~TYPE) | (header & TYPE)));
    if (!isStart && !this.#isInFragments) return;
    this.#parts.push(payload.subarray(2));
    this.#isInFragments = (header & FU_END) === 0;
  }

  /** @param {Uint8Array} unit whole, or its first byte */
  #unit(unit) {
    if (unit.length === 0) return;
    this.#isKeyframe ||= ((unit[0] ?? 0) & TYPE) === IDR;
    this.#parts.push(START_CODE, unit);
  }

  #damage() {
    this.#isDamaged = true;
    this.#isInFragments = false;
  }

  /** @param {number} timestamp @param {boolean} hasEnd @returns {Frame} */
  #finish(timestamp, hasEnd) {
    const data = joined(this.#parts);
    const isComplete = hasEnd && !this.#isDamaged && !this.#isInFragments && data.length > 0;
    const frame = { timestamp, data, isKeyframe: this.#isKeyframe, isComplete };
    this.#parts = [];
    this.#isDamaged = this.#isKeyframe = this.#isInFragments = false;
    return frame;
  }
}

/** @param {Uint8Array[]} parts */
export function joined(parts) {
  const all = new Uint8Array(parts.reduce((bytes, part) => bytes + part.length, 0));
  let at = 0;
  for (const part of parts) {
    all.set(part, at);
    at += part.length;
  }
  return all;
}
