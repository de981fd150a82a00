/** A gamepad as a controller, by the Gamepad API's standard layout; pure. */

/** A reading counts for so long [ms]: the deadman is not held by what the pad told before. */
const FRESH_MS = 150;
const STILL = 0.15; // of a stick that nobody holds
const [A, B, BUMPER, TRIGGER, MENU] = [0, 1, 4, 7, 9];
const DOWN_ABOVE = 0.6;
const UP_BELOW = 0.4;
export const REFUSED =
  "The gamepad does not tell how old its readings are while it is held still: drive with the keys.";

/**
 * @typedef {{ mapping: string, connected: boolean, timestamp: number, axes: readonly number[],
 *   buttons: readonly { value: number }[] }} PadReading as of a `Gamepad`
 */

/**
 * What a pad asks for. It drives only while its time stamp advances, also if it is held still:
 * otherwise nobody knows whether the trigger is held or the pad is gone.
 */
export class Pad {
  #stamp = 0;
  #advancedMs = -Infinity;
  /** @type {(boolean | null)[]} null: not known, as at the first reading */
  #down = [null, null, null, null];
  /** @type {[number, number, number, number]} */
  #presses = [0, 0, 0, 0];
  #wasReleased = false; // the trigger, since the pad could not be trusted
  /** Why it does not drive although its trigger is held; "" while it does. */
  refusal = "";

  /**
   * @param {number} nowMs @param {PadReading | null | undefined} pad @param {boolean} isSeen
   * @returns {import("./hand.js").Asked | null} null: there is none, or it must not drive
   */
  step(nowMs, pad, isSeen) {
    this.refusal = "";
    if (!pad?.connected || pad.mapping !== "standard") return null;
    if (pad.timestamp !== this.#stamp) this.#advancedMs = nowMs;
    this.#stamp = pad.timestamp;
    const value = (/** @type {number} */ place) => pad.buttons[place]?.value ?? 0;
    this.#count([value(BUMPER), value(A), value(B), value(MENU)]);
    const [trigger, isFresh] = [value(TRIGGER), nowMs - this.#advancedMs <= FRESH_MS];
    this.#wasReleased = isFresh && isSeen && (this.#wasReleased || trigger <= UP_BELOW);
    if (!isFresh && trigger > DOWN_ABOVE) this.refusal = REFUSED;
    if (!isFresh) return null;
    const [leftX, leftY, rightX, rightY] = [0, 1, 2, 3].map((place) => bent(pad.axes[place] ?? 0));
    const [forward, left] = [-(leftY ?? 0), -(leftX ?? 0)];
    return {
      linear: [forward, left, -(rightY ?? 0)],
      angular: [-left, forward, -(rightX ?? 0)],
      trigger: this.#wasReleased ? trigger : 0,
      grip: value(BUMPER),
      a: this.#down[1] === true,
      b: this.#down[2] === true,
      menu: this.#down[3] === true,
      presses: this.#presses,
    };
  }

  /** @param {number[]} values a button between the two bounds stays as it was */
  #count(values) {
    const before = this.#down;
    this.#down = values.map((value, place) => {
      const was = before[place] ?? null;
      if (value <= UP_BELOW) return false;
      return value >= DOWN_ABOVE ? was !== null || null : was;
    });
    const more = this.#down.map((is, place) => Number(is === true && before[place] === false));
    const [grip = 0, a = 0, b = 0, menu = 0] = this.#presses.map((sum, at) => sum + (more[at] ?? 0));
    this.#presses = [grip, a, b, menu];
  }
}

/** @param {number} value of an axis, 0 near its middle */
function bent(value) {
  return Math.abs(value) < STILL ? 0 : (value - Math.sign(value) * STILL) / (1 - STILL);
}
