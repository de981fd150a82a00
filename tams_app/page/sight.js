/** Which frames the operator can see, as far as the browser tells; pure. */

/** A page that was not painted for so long [ms] is not seen, and nothing is held in it. */
export const PAINTED_MS = 150;

/**
 * The frames on the canvases: by place, the RTP timestamp of the newest that counts, and whether a
 * newer one is there that is not whole.
 * @typedef {{ shown: (number | null)[], damaged: boolean[] }} Drawn
 */

/**
 * Seen is what was drawn before the last animation frame but one.
 *
 * A browser calls for an animation frame before it paints, and again only once its compositor has
 * taken what was painted. So calls end when nothing is shown any more: hidden, covered, asleep.
 */
export class Sight {
  #resolutionMs;
  /** @type {Drawn} */
  #drawn;
  #painted;
  /** @type {Drawn} what the compositor has taken */
  seen;
  paintedMs = -Infinity;
  #isThere = false;

  /** @param {number} views how many @param {number} resolutionMs steps of the clock */
  constructor(views, resolutionMs) {
    this.#resolutionMs = resolutionMs;
    this.#drawn = { shown: Array(views).fill(null), damaged: Array(views).fill(false) };
    this.#painted = this.seen = this.#drawn;
  }

  /**
   * A frame is on its canvas from now on.
   * @param {number} place @param {number} timestamp @param {boolean} isWhole
   */
  draw(place, timestamp, isWhole) {
    const { shown, damaged } = this.#drawn;
    this.#drawn = {
      shown: isWhole ? replaced(shown, place, timestamp) : shown,
      damaged: replaced(damaged, place, !isWhole),
    };
  }

  /** @param {number} nowMs an animation frame began */
  paint(nowMs) {
    this.seen = this.#painted;
    this.#painted = this.#drawn;
    this.paintedMs = nowMs;
  }

  /** @param {boolean} isThere the page is visible and has the focus */
  look(isThere) {
    this.#isThere = isThere;
  }

  /** Whether the operator sees the page now. @param {number} nowMs */
  isSeen(nowMs) {
    return this.#isThere && nowMs - this.paintedMs + this.#resolutionMs <= PAINTED_MS;
  }
}

/**
 * @template T
 * @param {T[]} values
 * @param {number} place
 * @param {T} value
 */
function replaced(values, place, value) {
  return values.map((one, at) => (at === place ? value : one));
}
