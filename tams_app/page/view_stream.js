/** One view in the worker: packets in, decoded frames out. */

import { ViewReceiver } from "./receive/view_receiver.js";

const KEPT = 64; // frames in the decoder: more than any keeps
const UNTAKEN = 3; // frames that wait for the page; more would only be older
const QUEUED = 8; // a decoder so far behind begins anew with a keyframe
const SPS = 7;

/**
 * @typedef {{ timestamp: number, isWhole: boolean }} Shown
 * @typedef {(frame: VideoFrame, shown: Shown) => void} Show
 * @typedef {{ rule: import("./receive/rule.js").RepairRule, feedback: boolean }} Stream
 */

export class ViewStream {
  #place;
  #stream;
  #show;
  #receiver;
  /** @type {VideoDecoder | null} before the first keyframe, and after a failure */
  #decoder = null;
  #codec = "";
  /** @type {Map<number, Shown>} by the frame's time [µs] */
  #decoding = new Map();
  /** Frames that the page has not taken yet. */
  waiting = 0;

  /** @param {number} place @param {Stream} stream @param {Show} show takes over the frame */
  constructor(place, stream, show) {
    this.#place = place;
    this.#stream = stream;
    this.#show = show;
    this.#receiver = this.#begun();
  }

  /** @param {number} nowMs @param {Uint8Array} packet @returns {Uint8Array[]} RTCP to send */
  receive(nowMs, packet) {
    return this.#take(this.#receiver.receive(nowMs, packet));
  }

  /** @param {number} nowMs @returns {Uint8Array[]} RTCP to send */
  poll(nowMs) {
    return nowMs < this.#receiver.nextMs ? [] : this.#take(this.#receiver.poll(nowMs));
  }

  close() {
    if (this.#decoder?.state !== "closed") this.#decoder?.close();
    this.#decoder = null;
  }

  /** @param {import("./receive/view_receiver.js").Outcome} outcome */
  #take({ units, rtcp }) {
    for (const unit of units) this.#decode(unit);
    return rtcp;
  }

  #begun() {
    return new ViewReceiver(this.#place, this.#stream.rule, this.#stream.feedback);
  }

  /** @param {import("./receive/view_receiver.js").AccessUnit} unit */
  #decode(unit) {
    if (unit.isKeyframe) this.#configure(unit.data);
    const decoder = this.#decoder; // which may fail at once
    if (decoder === null || unit.data.length === 0) return;
    const micros = Math.round((unit.ticks * 100) / 9);
    const { timestamp, isWhole, data } = unit;
    this.#decoding.set(micros, { timestamp, isWhole });
    const [oldest] = this.#decoding.keys();
    if (this.#decoding.size > KEPT && oldest !== undefined) this.#decoding.delete(oldest);
    const type = unit.isKeyframe ? "key" : "delta";
    decoder.decode(new EncodedVideoChunk({ type, timestamp: micros, data }));
    if (decoder.decodeQueueSize > QUEUED) this.#restart();
  }

  /** @param {Uint8Array} keyframe */
  #configure(keyframe) {
    const codec = codecOf(keyframe) ?? this.#codec;
    if (!codec || (this.#decoder !== null && codec === this.#codec)) return;
    this.close();
    this.#codec = codec;
    this.#decoder = new VideoDecoder({
      output: (frame) => this.#decoded(frame),
      error: () => this.#restart(),
    });
    this.#decoder.configure({ codec, optimizeForLatency: true });
  }

  /** What is decoded from now on begins with a keyframe, which a new receiver asks for. */
  #restart() {
    this.close();
    this.#receiver = this.#begun();
  }

  /** @param {VideoFrame} frame */
  #decoded(frame) {
    const shown = this.#decoding.get(frame.timestamp);
    this.#decoding.delete(frame.timestamp);
    if (shown === undefined || this.waiting >= UNTAKEN) return frame.close();
    this.waiting += 1;
    this.#show(frame, shown);
  }
}

/**
 * The codec as WebCodecs names it, from the sequence parameter set; null: there is none.
 * @param {Uint8Array} unit Annex B
 */
export function codecOf(unit) {
  for (let at = 0; at + 6 < unit.length; at++) {
    const isStart = unit[at] === 0 && unit[at + 1] === 0 && unit[at + 2] === 1;
    if (!isStart || ((unit[at + 3] ?? 0) & 0x1f) !== SPS) continue;
    const bytes = [...unit.subarray(at + 4, at + 7)];
    return `avc1.${bytes.map((byte) => byte.toString(16).padStart(2, "0")).join("")}`;
  }
  return null;
}
