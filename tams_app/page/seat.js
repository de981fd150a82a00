/** The operator's seat: what they hold and ask for, as samples for the robot; pure. */

import { toNs } from "./clock.js";
import { Taps, VirtualHand, askedByKeys } from "./hand.js";
import { Keys } from "./keys.js";
import { Pad } from "./pad.js";

// The robot holds once the buttons are 100 ms old (`freshness.buttons_ms`). They are as old as what
// was painted last, which may be 50 ms older (`PAINTED_MS`).
const LATE_MS = 50;
const AWAKE_AFTER_MS = 200; // of a computer that was asleep

/**
 * @typedef {import("./messages.js").HandMessage} HandMessage
 * @typedef {Omit<HandMessage, "operator" | "simulated" | "sent_ns" | "echo_ns" | "echo_heard_ns" |
 *   "noted">} Told
 * @typedef {Told & { paintedMs: number }} Sample and when the page was painted last
 */

const NOTHING = { trigger: 0, grip: 0, a: false, b: false, menu: false };

/** The same of a hand that holds nothing. @param {Sample} sample @returns {Sample} */
export function released(sample, status = "standby") {
  return { ...sample, status, pose: null, ...NOTHING };
}

export class Seat {
  keys = new Keys();
  pad = new Pad();
  /** Place of the pinned view. @type {number | null} */
  pinned = null;
  hand = "keyboard";
  stops = 0;
  #confirms = 0;
  #confirmedMs = 0;
  #episodes = [0, 0, 0, 0, 0];
  #newHand;
  #sight;
  #taps;
  #virtual;
  #poseMs = 0;
  #buttonsMs = 0;
  #lastMs = -Infinity;
  #asleepUntilMs = -Infinity;

  /**
   * @param {{ speed_m_s: number, turn_rad_s: number }} desk
   * @param {number[][]} rotation `SessionDescription.hand_rotation`
   * @param {import("./sight.js").Sight} sight
   */
  constructor(desk, rotation, sight) {
    this.#newHand = () => new VirtualHand(desk, rotation);
    this.#sight = sight;
    this.#taps = new Taps(desk.speed_m_s);
    this.#virtual = this.#newHand();
  }

  /** @param {number} askedMs when they confirmed */
  confirm(askedMs) {
    this.#confirms += 1;
    this.#confirmedMs = askedMs;
  }

  /** @param {number} place of the request among all about episodes */
  episode(place) {
    this.#episodes = this.#episodes.map((count, at) => count + Number(at === place));
  }

  /** The computer was asleep: what was held or confirmed counts no more. @param {number} nowMs */
  wake(nowMs) {
    this.#asleepUntilMs = nowMs + AWAKE_AFTER_MS;
    this.#confirmedMs = 0;
  }

  /**
   * The sample of this moment. Where the page was not seen, what is held must be pressed anew.
   * @param {number} nowMs @param {import("./pad.js").PadReading | null | undefined} pad
   * @returns {Sample}
   */
  sample(nowMs, pad) {
    const stoodStill = nowMs - this.#lastMs > 2 * LATE_MS;
    this.#lastMs = nowMs;
    const isAwake = nowMs >= this.#asleepUntilMs;
    const isSeen = this.#sight.isSeen(nowMs) && !stoodStill && isAwake;
    this.keys.focus(isSeen);
    const { held, presses: downs } = this.keys;
    const byKeys = askedByKeys(held, downs, this.#taps.step(nowMs, held, downs));
    const byPad = this.pad.step(nowMs, pad, isSeen);
    if (byPad !== null && byPad.trigger > 0 && byKeys.trigger === 0) this.hand = "gamepad";
    else if (byPad === null || byKeys.trigger > 0) this.hand = "keyboard";
    const asked = this.hand === "gamepad" && byPad !== null ? byPad : byKeys;
    if (isSeen) {
      this.#poseMs = nowMs;
      this.#buttonsMs = Math.min(nowMs, this.#sight.paintedMs + LATE_MS);
    } else this.#virtual = this.#newHand();
    const { trigger, grip, a, b, menu, presses } = asked;
    const sample = {
      status: "ok",
      pose: isSeen ? this.#virtual.step(nowMs, asked) : null,
      pose_ns: toNs(this.#poseMs),
      buttons_ns: toNs(this.#buttonsMs),
      ...{ trigger, grip, a, b, menu, presses },
      ...this.#sight.seen,
      confirms: this.#confirms,
      confirmed_ns: toNs(this.#confirmedMs),
      stops: this.stops,
      hand: this.hand,
      episodes: this.#episodes,
      pinned: this.pinned,
      paintedMs: this.#sight.paintedMs,
    };
    return isSeen ? sample : released(sample, isAwake ? "standby" : "link lost");
  }
}
