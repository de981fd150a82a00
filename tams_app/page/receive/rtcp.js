/**
 * What a view's receiver tells its sender (RTCP): reports, what it asks for, when packets came.
 *
 * RFC 3550 (reports), RFC 4585 (NACK, PLI), draft-holmer-rmcat-transport-wide-cc-extensions-01.
 */

import { joined } from "./h264.js";
import { SEQUENCES, TICKS_PER_MS, TIMESTAMPS, dataView, nearest, remainder } from "./rtp.js";

/** @typedef {import("./rtp.js").RtpPacket} RtpPacket */

const VERSION_2 = 0x80;
const WORD_BYTES = 4;
const SENDER_REPORT = { type: 200, bytes: 28 };
const TYPES = { report: 201, name: 202, transport: 205, payload: 206 };
const FORMATS = { nack: 1, arrivals: 15, pli: 1 };
const NACK_REACH = 16; // an entry asks for a packet and any of the 16 that follow
const NAME = Uint8Array.of(1, 4, 0x74, 0x61, 0x6d, 0x73, 0, 0); // CNAME

const TICKS_OF_ARRIVAL_PER_MS = 4;
const REFERENCE_TICKS = 256; // 64 ms
const [LOST, SMALL_DELTA, LARGE_DELTA] = [0, 1, 2];
const VECTOR = { bits: 0b11, length: 7 };
const LONGEST_RUN = 0x1fff;
const LONGEST_GAP = 4096;

/** The reports of the media stream (RFC 3550, A.3 and A.8): what came of it, and the round trip. */
export class Reception {
  /** @type {number | null} */
  #first = null;
  #highest = -1;
  #received = 0;
  #before = { expected: 0, received: 0 }; // at the last report
  /** @type {number | null} */
  #transit = null;
  #jitter = 0; // 16 times
  #senderReport = { ntp: 0, atMs: 0 }; // the middle of the last one's time, and when it came
  #ssrc;

  /** @param {number} mediaSsrc */
  constructor(mediaSsrc) {
    this.#ssrc = mediaSsrc;
  }

  /** A packet of the media stream came. @param {number} nowMs @param {RtpPacket} packet */
  received(nowMs, packet) {
    if (this.#first === null) this.#first = this.#highest = packet.sequence;
    this.#highest = Math.max(this.#highest, nearest(this.#highest, packet.sequence, SEQUENCES));
    this.#received++;
    const transit = Math.floor(nowMs * TICKS_PER_MS) - packet.timestamp;
    if (this.#transit !== null) {
      const change = Math.abs(nearest(this.#transit, transit, TIMESTAMPS) - this.#transit);
      this.#jitter += change - ((this.#jitter + 8) >> 4);
    }
    this.#transit = transit;
  }

  /** RTCP of the sender came. @param {number} nowMs @param {Uint8Array} bytes */
  reported(nowMs, bytes) {
    const view = dataView(bytes);
    for (let at = 0; at + SENDER_REPORT.bytes <= bytes.length; ) {
      const isReport = view.getUint8(at + 1) === SENDER_REPORT.type;
      if (isReport && view.getUint32(at + 4) === this.#ssrc) {
        this.#senderReport = { ntp: view.getUint32(at + 10), atMs: nowMs };
      }
      at += WORD_BYTES * (1 + view.getUint16(at + 2));
    }
  }

  /**
   * What every datagram begins with, after the first packet: report and name.
   * @param {number} nowMs @param {number} ssrc of the receiver
   */
  report(nowMs, ssrc) {
    const now = { expected: this.#highest - (this.#first ?? 0) + 1, received: this.#received };
    const expected = now.expected - this.#before.expected;
    const lost = Math.max(0, expected - (now.received - this.#before.received));
    const share = expected > 0 ? Math.min(255, Math.floor((256 * lost) / expected)) : 0;
    this.#before = now;
    const { ntp, atMs } = this.#senderReport;
    const since = ntp === 0 ? 0 : Math.round(((nowMs - atMs) * 2 ** 16) / 1000);
    const losses = share * 2 ** 24 + remainder(now.expected - now.received, 2 ** 24);
    const figures = [this.#ssrc, losses, Math.max(0, this.#highest), this.#jitter >> 4, ntp, since];
    const report = rtcp(TYPES.report, 1, words(ssrc, ...figures));
    return joined([report, rtcp(TYPES.name, 1, joined([words(ssrc), NAME]))]);
  }
}

/**
 * Asks for packets of the media stream to be sent again.
 * @param {number} ssrc of the receiver @param {number} mediaSsrc
 * @param {number[]} numbers in order, of 16 bits
 */
export function nack(ssrc, mediaSsrc, numbers) {
  /** @type {{ first: number, others: number }[]} */
  const entries = [];
  for (const number of numbers) {
    const last = entries.at(-1);
    const ahead = last === undefined ? Infinity : remainder(number - last.first, SEQUENCES);
    if (last !== undefined && ahead <= NACK_REACH) last.others |= 1 << (ahead - 1);
    else entries.push({ first: number, others: 0 });
  }
  const packed = entries.map(({ first, others }) => first * SEQUENCES + others);
  return rtcp(TYPES.transport, FORMATS.nack, words(ssrc, mediaSsrc, ...packed));
}

/** Asks for a keyframe. @param {number} ssrc of the receiver @param {number} mediaSsrc */
export function pli(ssrc, mediaSsrc) {
  return rtcp(TYPES.payload, FORMATS.pli, words(ssrc, mediaSsrc));
}

/** Tells when each packet of a view's session came, after the last packet of each frame. */
export class ArrivalLog {
  /** @type {Map<number, number>} ticks of arrival, by number */
  #arrived = new Map();
  /** @type {number | null} the first number that is not reported */
  #next = null;
  #highest = 0;
  #isDue = false;
  #messages = 0;
  #ssrcs;

  /** @param {number} ssrc of the receiver @param {number} mediaSsrc */
  constructor(ssrc, mediaSsrc) {
    this.#ssrcs = [ssrc, mediaSsrc];
  }

  /**
   * A packet of the session came; where later ones have been reported, it stays reported as lost.
   * @param {number} nowMs @param {RtpPacket} packet
   */
  received(nowMs, { transportSequence, marker }) {
    if (transportSequence === null) return;
    if (this.#next === null) this.#next = this.#highest = transportSequence;
    const number = nearest(this.#highest, transportSequence, SEQUENCES);
    if (number < this.#next || this.#arrived.has(number)) return;
    if (number > this.#highest + LONGEST_GAP) this.#next = number; // nobody remembers those before
    this.#arrived.set(number, Math.floor(nowMs * TICKS_OF_ARRIVAL_PER_MS));
    this.#highest = Math.max(this.#highest, number);
    this.#isDue ||= marker;
  }

  /** The message that is due, a packet of RTCP; null if none is. */
  take() {
    if (!this.#isDue || this.#next === null) return null;
    const statuses = [];
    const deltas = [];
    const [first = 0] = this.#arrived.values();
    const reference = Math.floor(first / REFERENCE_TICKS);
    let before = reference * REFERENCE_TICKS;
    for (let number = this.#next; number <= this.#highest; number++) {
      const ticks = this.#arrived.get(number);
      if (ticks === undefined) {
        statuses.push(LOST);
        continue;
      }
      const delta = Math.max(-0x8000, Math.min(ticks - before, 0x7fff));
      const isSmall = delta >= 0 && delta <= 0xff;
      statuses.push(isSmall ? SMALL_DELTA : LARGE_DELTA);
      deltas.push(...(isSmall ? [delta] : [(delta >> 8) & 0xff, delta & 0xff]));
      before += delta;
    }
    const numbers = remainder(this.#next, SEQUENCES) * SEQUENCES + statuses.length;
    const order = remainder(reference, 2 ** 24) * 256 + (this.#messages++ % 256);
    this.#next = this.#highest + 1;
    this.#isDue = false;
    this.#arrived.clear();
    const told = Uint8Array.from([...chunks(statuses), ...deltas]);
    const content = joined([words(...this.#ssrcs, numbers, order), told]);
    return rtcp(TYPES.transport, FORMATS.arrivals, content);
  }
}

/** Bytes of chunks: runs of one status, and vectors of seven. @param {number[]} statuses */
function chunks(statuses) {
  const bytes = [];
  for (let at = 0; at < statuses.length; ) {
    const status = statuses[at] ?? LOST;
    let run = 1;
    while (run < LONGEST_RUN && statuses[at + run] === status) run++;
    let chunk = status * 2 ** 13 + run;
    if (run < VECTOR.length && at + run < statuses.length) {
      run = VECTOR.length;
      chunk = VECTOR.bits;
      for (let place = 0; place < run; place++) chunk = chunk * 4 + (statuses[at + place] ?? LOST);
    }
    bytes.push(chunk >> 8, chunk & 0xff);
    at += run;
  }
  return bytes;
}

/**
 * A packet of RTCP, filled up with zeros to whole words.
 * @param {number} type @param {number} count or format @param {Uint8Array} content
 */
function rtcp(type, count, content) {
  const length = Math.ceil(content.length / WORD_BYTES);
  const packet = new Uint8Array(WORD_BYTES * (1 + length));
  packet.set([VERSION_2 | count, type, length >> 8, length & 0xff]);
  packet.set(content, WORD_BYTES);
  return packet;
}

/** @param {number[]} numbers of 32 bits */
function words(...numbers) {
  const bytes = new Uint8Array(WORD_BYTES * numbers.length);
  numbers.forEach((number, place) => dataView(bytes).setUint32(WORD_BYTES * place, number));
  return bytes;
}
