/** The page's one clock, and the robot's clock against it. */

const DRIFT = 500e-6; // as in `tams_app/link/age.py`
const FROM_MS = 1000; // so that no time is 0, which means never

/**
 * The time [ms] since a moment that page and worker agree on; it never goes back.
 *
 * A worker's `performance.now` begins when the worker does, so both count from the page's origin.
 */
export class PageClock {
  #aheadMs;

  /** @param {number} originMs the page's `performance.timeOrigin` */
  constructor(originMs) {
    this.#aheadMs = performance.timeOrigin - originMs + FROM_MS;
  }

  now() {
    return performance.now() + this.#aheadMs;
  }
}

/** The time [ns] of a time [ms]. @param {number} ms */
export function toNs(ms) {
  return Math.round(ms * 1e6);
}

/** The step [ms] of a clock: an age by it may be so much too short. @param {() => number} now */
export function resolution(now) {
  const steps = [1, 2, 3].map(() => {
    const from = now();
    let to = now();
    while (to === from) to = now();
    return to - from;
  });
  return Math.min(...steps);
}

/**
 * The robot's clock minus ours, from exchanges, as `PeerClock` of `tams_app/link/age.py` has it.
 *
 * For what is shown alone: the robot judges itself how old a sample or a frame is.
 */
export class RobotClock {
  #leastNs = -Infinity;
  #mostNs = Infinity;
  #atNs = 0;
  #sinceNs = 0; // an exchange that began before counts for nothing

  /**
   * An exchange: we sent, the robot received, it sent, we received [ns, each by its own clock].
   * @param {number} echoNs 0: the robot has received nothing yet @param {number} echoHeardNs
   * @param {number} sentNs @param {number} receivedNs
   */
  step(echoNs, echoHeardNs, sentNs, receivedNs) {
    if (echoNs <= this.#sinceNs || echoHeardNs <= 0) return;
    const driftNs = DRIFT * (receivedNs - this.#atNs);
    const widerNs = DRIFT * (receivedNs - echoNs);
    this.#leastNs = Math.max(sentNs - receivedNs - widerNs, this.#leastNs - driftNs);
    this.#mostNs = Math.min(echoHeardNs - echoNs + widerNs, this.#mostNs + driftNs);
    this.#atNs = receivedNs;
    if (this.#leastNs <= this.#mostNs) return;
    [this.#leastNs, this.#mostNs, this.#sinceNs] = [-Infinity, Infinity, receivedNs];
  }

  /** The offset [ns]; null: not known yet. */
  get offsetNs() {
    return Number.isFinite(this.#mostNs) ? (this.#leastNs + this.#mostNs) / 2 : null;
  }

  /** The time of the fastest messages of both ways together [ms]; null: not known yet. */
  get roundTripMs() {
    return Number.isFinite(this.#mostNs) ? (this.#mostNs - this.#leastNs) / 1e6 : null;
  }
}
