/**
 * A view's receiver: RTP and RTCP of its sender in, frames and RTCP to send out.
 *
 * Without socket and clock: whoever moves it hands in times [ms, of any one clock that never goes
 * back]. It promises what `tams_app/video/core/receiver.py` does: a frame is whole only if every
 * packet of its chain, back to a keyframe, is here; while none is, keyframes are asked for.
 */

import { Depacketizer, joined } from "./h264.js";
import { PacketOrder } from "./order.js";
import { ParityDecoder } from "./parity.js";
import { ArrivalLog, Reception, nack, pli } from "./rtcp.js";
import { TICKS_PER_MS, TIMESTAMPS, isRtcp, nearest, original, readRtp, viewSsrcs } from "./rtp.js";
import { KeyframeRequests, RepairWait } from "./rule.js";

/** @typedef {import("./rtp.js").RtpPacket} RtpPacket */

/**
 * @typedef {object} AccessUnit
 * @property {Uint8Array} data Annex B
 * @property {number} timestamp of RTP: which frame it is
 * @property {number} ticks the timestamp counted on through its wraps, of a clock of 90 kHz
 * @property {boolean} isKeyframe
 * @property {boolean} isWhole as it was encoded, and so is its chain: what else there is may be
 *     shown, but must not be steered by
 * @property {number} receivedMs when its last packet could be handed on
 */

/**
 * What comes of a datagram or of time: frames in order, and datagrams to send now.
 *
 * @typedef {{ units: AccessUnit[], rtcp: Uint8Array[] }} Outcome
 */

// Without feedback the reports are the budget's eyes; beside it they tell the round trip alone.
const REPORTS_MS = { alone: 50, besideFeedback: 500 };

export class ViewReceiver {
  #depacketizer = new Depacketizer();
  #ticks = 0;
  #isUnbroken = false; // the chain: nothing can be predicted before the first keyframe
  #nextReportMs = Infinity;
  #ssrcs;
  #reportsMs;
  #reception;
  #arrivals;
  #parity;
  #order;
  #wait;
  #requests;
  #rtx;

  /**
   * @param {number} place of the view in the configuration
   * @param {import("./rule.js").RepairRule} rule the sender must agree about RTX
   * @param {boolean} feedback it reports when each packet came; the sender must agree
   */
  constructor(place, rule, feedback) {
    const { receiver, media } = (this.#ssrcs = viewSsrcs(place));
    this.#rtx = rule.rtx;
    this.#reportsMs = feedback ? REPORTS_MS.besideFeedback : REPORTS_MS.alone;
    this.#reception = new Reception(media);
    this.#arrivals = feedback ? new ArrivalLog(receiver, media) : null;
    this.#parity = rule.parity ? new ParityDecoder(media) : null;
    this.#order = new PacketOrder(rule.latencyMs);
    this.#wait = new RepairWait(rule);
    this.#requests = new KeyframeRequests(rule);
  }

  /**
   * A datagram of the view's sender came; what is no packet of it is ignored.
   * @param {number} nowMs @param {Uint8Array} bytes not to be changed afterwards @returns {Outcome}
   */
  receive(nowMs, bytes) {
    const packet = isRtcp(bytes) ? null : readRtp(bytes);
    if (isRtcp(bytes)) this.#reception.reported(nowMs, bytes);
    if (packet !== null && Object.values(this.#ssrcs).includes(packet.ssrc)) {
      if (this.#nextReportMs === Infinity) this.#nextReportMs = nowMs + this.#reportsMs;
      this.#arrivals?.received(nowMs, packet);
      for (const restored of this.#packet(nowMs, packet)) this.#order.fill(nowMs, restored);
    }
    return this.poll(nowMs);
  }

  /** When `poll` must be called [ms] if nothing comes before; Infinity: not at all. */
  get nextMs() {
    return Math.min(this.#nextReportMs, this.#order.nextMs);
  }

  /** What is due by now. @param {number} nowMs @returns {Outcome} */
  poll(nowMs) {
    const units = [];
    for (const { packet, isAfterGap } of this.#order.take(nowMs)) {
      if (isAfterGap) this.#requests.lost(nowMs);
      const frames = this.#depacketizer.add(packet, isAfterGap);
      units.push(...frames.map((frame) => this.#unit(nowMs, frame)));
    }
    return { units, rtcp: this.#rtcp(nowMs) };
  }

  /** What it restores. @param {number} nowMs @param {RtpPacket} packet @returns {RtpPacket[]} */
  #packet(nowMs, packet) {
    const { media, repair, parity } = this.#ssrcs;
    if (packet.ssrc === media) {
      this.#reception.received(nowMs, packet);
      this.#order.add(nowMs, packet);
      return this.#parity?.media(packet) ?? [];
    }
    const resent = packet.ssrc === repair ? original(packet, media) : null;
    if (resent !== null) {
      this.#order.fill(nowMs, resent);
      return this.#parity?.media(resent) ?? [];
    }
    return (packet.ssrc === parity && this.#parity?.parity(packet)) || [];
  }

  /** @param {number} nowMs @param {import("./h264.js").Frame} frame @returns {AccessUnit} */
  #unit(nowMs, { timestamp, data, isKeyframe, isComplete }) {
    this.#ticks = nearest(this.#ticks, timestamp, TIMESTAMPS);
    this.#order.waitMs = this.#wait.after(this.#ticks / TICKS_PER_MS);
    const isWhole = isComplete && (isKeyframe || this.#isUnbroken);
    this.#isUnbroken = isWhole;
    this.#requests.frame(nowMs, isWhole);
    return { data, timestamp, ticks: this.#ticks, isKeyframe, isWhole, receivedMs: nowMs };
  }

  /** @param {number} nowMs */
  #rtcp(nowMs) {
    const { receiver, media } = this.#ssrcs;
    const parts = [];
    const numbers = this.#order.takeRequests();
    if (this.#rtx && numbers.length > 0) parts.push(nack(receiver, media, numbers));
    if (this.#requests.take()) parts.push(pli(receiver, media));
    const datagrams = [];
    if (parts.length > 0 || nowMs >= this.#nextReportMs) {
      datagrams.push(joined([this.#reception.report(nowMs, receiver), ...parts]));
      this.#nextReportMs = nowMs + this.#reportsMs;
    }
    const arrivals = this.#arrivals?.take() ?? null;
    return arrivals === null ? datagrams : [...datagrams, arrivals];
  }
}
