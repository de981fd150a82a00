/** The repair of lost packets: how long one is waited for, and when a keyframe is asked for. */

const FRAME_MS = { usual: 1000 / 30, longest: 250 }; // between two
const REMEMBERED = 3; // the least whose median one missed frame does not move

/**
 * As `RepairRule` of `tams_app/video/core/repair.py`.
 *
 * @typedef {object} RepairRule
 * @property {boolean} rtx lost packets are asked for and sent again
 * @property {number} latencyMs a missing packet is waited for so long at 30 frames a second
 * @property {number} pliIntervalMs at most one keyframe request in this time
 * @property {boolean} pli keyframes are requested at all
 * @property {boolean} parity the view may be protected by parity packets
 * @property {number} longestWaitMs a missing packet is waited for so long at most, at any rate
 */

/** How long a missing packet is waited for: the rarer the frames, the longer. */
export class RepairWait {
  /** @type {number[]} of the last frames */
  #capturesMs = [];
  #rule;

  /** @param {RepairRule} rule */
  constructor(rule) {
    this.#rule = rule;
  }

  /** The wait [ms] after the next frame. @param {number} captureMs since any moment */
  after(captureMs) {
    const times = (this.#capturesMs = [...this.#capturesMs, captureMs].slice(-1 - REMEMBERED));
    if (!this.#rule.rtx) return this.#rule.latencyMs;
    const between = times.slice(1).map((time, place) => time - (times[place] ?? 0));
    const median = between.sort((one, other) => one - other)[between.length >> 1] ?? 0;
    const rarerMs = Math.floor(Math.max(0, Math.min(median, FRAME_MS.longest) - FRAME_MS.usual));
    return Math.floor(Math.min(this.#rule.latencyMs + rarerMs, this.#rule.longestWaitMs));
  }
}

/**
 * Keyframe requests (PLI), one per interval: an early one waits for its turn.
 *
 * A whole frame answers every request before it. A request that stays unanswered for two intervals
 * was lost itself and is sent again.
 */
export class KeyframeRequests {
  #lastMs = -Infinity;
  #isUnanswered = false;
  #isWaiting = false; // a loss later than the last request
  #isDue = false;
  #rule;

  /** @param {RepairRule} rule */
  constructor(rule) {
    this.#rule = rule;
  }

  /** A loss was seen. @param {number} nowMs */
  lost(nowMs) {
    this.#isUnanswered = this.#isWaiting = true;
    this.#ask(nowMs);
  }

  /** A frame came. @param {number} nowMs @param {boolean} isWhole */
  frame(nowMs, isWhole) {
    this.#isUnanswered = !isWhole;
    this.#isWaiting &&= !isWhole;
    this.#ask(nowMs);
  }

  /** Whether a request must leave now. */
  take() {
    const isDue = this.#isDue;
    this.#isDue = false;
    return isDue;
  }

  /** @param {number} nowMs */
  #ask(nowMs) {
    const waitMs = this.#rule.pliIntervalMs * (this.#isWaiting ? 1 : 2);
    if (!this.#rule.pli || !this.#isUnanswered || nowMs - this.#lastMs < waitMs) return;
    this.#isWaiting = false;
    this.#isDue = true;
    this.#lastMs = nowMs;
  }
}
