/**
 * The packets of one view in the order of their numbers, and which of the missing to ask for.
 *
 * A packet is missing from the moment when a later one comes. It is asked for at once, and waited
 * for as long as the repair rule says, in which there is time for one answer; nothing after it is
 * handed out meanwhile. A cut is not waited for whose oldest packet the sender no longer keeps.
 */

import { SEQUENCES, TICKS_PER_MS, TIMESTAMPS, nearest, remainder } from "./rtp.js";

/** @typedef {import("./rtp.js").RtpPacket} RtpPacket */

// Numbers further away are of another stream, if a second packet says so (RFC 3550, A.1).
const MOST_AHEAD = 3000;
const MOST_BEHIND = 100;
const KEPT_MS = 1000; // by the sender (`RTX_HISTORY_MS`)
const SILENCE_MS = 3000; // numbers may have wrapped meanwhile

export class PacketOrder {
  #isBegun = false;
  #next = 0; // to be handed out; counted on through the wraps
  #highest = 0;
  #timestamp = 0; // of the highest
  #isAfterGap = false; // the next
  #confirming = -1; // the number that shows that the stream has started anew
  /** @type {Map<number, RtpPacket>} */
  #held = new Map();
  /** @type {Map<number, number>} when each is given up [ms] */
  #missing = new Map();
  /** @type {number[]} missing since `takeRequests` */
  #unasked = [];

  /** For what will be missing. @param {number} waitMs */
  constructor(waitMs) {
    this.waitMs = waitMs;
  }

  /** A packet came, in any order, perhaps twice. @param {number} nowMs @param {RtpPacket} packet */
  add(nowMs, packet) {
    const number = nearest(this.#highest, packet.sequence, SEQUENCES);
    if (!this.#isBegun) {
      this.#start(packet, packet.sequence !== 0);
    } else if (number > this.#highest + MOST_AHEAD || number < this.#next - MOST_BEHIND) {
      if (packet.sequence === this.#confirming) this.#start(packet, true);
      this.#confirming = (packet.sequence + 1) % SEQUENCES;
    } else if (number > this.#highest && this.#isCutOff(number, packet.timestamp)) {
      this.#start(packet, true);
    } else if (number >= this.#next) {
      for (let one = this.#highest + 1; one < number; one++) {
        this.#missing.set(one, nowMs + this.waitMs);
        this.#unasked.push(one);
      }
      if (number > this.#highest) this.#timestamp = packet.timestamp;
      this.#highest = Math.max(this.#highest, number);
      this.#missing.delete(number);
      this.#held.set(number, packet);
    }
  }

  /**
   * A packet came that was resent or restored: never the start of a new stream, but perhaps the end
   * of a frame of which nothing shows yet that it is missing.
   * @param {number} nowMs @param {RtpPacket} packet
   */
  fill(nowMs, packet) {
    const number = nearest(this.#highest, packet.sequence, SEQUENCES);
    const isOfUse = number >= this.#next && number <= this.#highest + MOST_AHEAD;
    if (this.#isBegun && isOfUse) this.add(nowMs, packet);
  }

  /** What can be handed out now, in order; `isAfterGap`: others are lost. @param {number} nowMs */
  take(nowMs) {
    const taken = [];
    for (; this.#held.size > 0; this.#next++) {
      const packet = this.#held.get(this.#next);
      if (packet === undefined) {
        if (nowMs < (this.#missing.get(this.#next) ?? nowMs)) break;
        this.#missing.delete(this.#next);
        this.#isAfterGap = true;
      } else {
        taken.push({ packet, isAfterGap: this.#isAfterGap });
        this.#held.delete(this.#next);
        this.#isAfterGap = false;
      }
    }
    return taken;
  }

  /** The numbers to ask for now, in order. */
  takeRequests() {
    const numbers = this.#unasked.splice(0).filter((number) => this.#missing.has(number));
    return numbers.map((number) => remainder(number, SEQUENCES));
  }

  /** When `take` must be called [ms], though nothing comes; Infinity: never. */
  get nextMs() {
    return this.#missing.get(this.#next) ?? Infinity;
  }

  /** @param {RtpPacket} packet @param {boolean} isAfterGap */
  #start(packet, isAfterGap) {
    this.#isBegun = true;
    this.#next = this.#highest = packet.sequence;
    this.#timestamp = packet.timestamp;
    this.#isAfterGap = isAfterGap;
    this.#missing.clear();
    this.#held.clear();
    this.#held.set(this.#next, packet);
  }

  /** What is between can no longer come. @param {number} number @param {number} timestamp */
  #isCutOff(number, timestamp) {
    const ticks = nearest(this.#timestamp, timestamp, TIMESTAMPS) - this.#timestamp;
    return ticks > TICKS_PER_MS * (number === this.#highest + 1 ? SILENCE_MS : KEPT_MS);
  }
}
