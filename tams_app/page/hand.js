/**
 * A hand that keys or a gamepad move at a speed; pure.
 *
 * As `hw/desk/keyboard.py`, whose numbers these are: the arm must do the same for the same keys.
 */

/**
 * @typedef {[number, number, number]} Vector
 * @typedef {[number, number, number, number]} Quaternion x, y, z, w
 *
 * What keys or sticks ask for: forward, left and up, and turns about the same, each -1 to 1; the
 * deadman and the buttons, and how often grip, a, b and menu were pressed.
 * @typedef {{ linear: Vector, angular: Vector, trigger: number, grip: number, a: boolean, b: boolean,
 *   menu: boolean, presses: [number, number, number, number] }} Asked
 */

/** @type {[string, number, number][]} key, axis, direction */
const AXES = [["w", 0, 1], ["s", 0, -1], ["a", 1, 1], ["d", 1, -1], ["r", 2, 1], ["f", 2, -1]];
const DEADMAN = "shift";
const TAP_M = 0.0015; // that one press of a key moves the hand, and no more until it counts as held
const TAP_MS = 250;
const RAMP_S = 0.25; // from rest to full speed
const LONGEST_GAP_MS = 50; // what was asked for in a longer one is not made up for
/** @type {Vector} */
const ZERO = [0, 0, 0];

/** Deflection by each key: a press makes a step, a key that stays down deflects in full. */
export class Taps {
  #share;
  /** @type {Record<string, number>} */
  #presses = {};
  /** @type {Map<string, number>} since when */
  #downMs = new Map();
  /** @type {Map<string, number>} until when its presses move the hand */
  #stepMs = new Map();

  /** @param {number} speed of the hand at full deflection [m/s] */
  constructor(speed) {
    this.#share = Math.min(TAP_M / (TAP_MS / 1000) / speed, 1);
  }

  /**
   * The deflection by key, 0 to 1; without the deadman nothing begins or goes on.
   * @param {number} nowMs @param {Set<string>} held @param {Record<string, number>} presses
   * @returns {Map<string, number>}
   */
  step(nowMs, held, presses) {
    const before = this.#presses;
    this.#presses = presses;
    if (!held.has(DEADMAN)) {
      this.#downMs.clear();
      this.#stepMs.clear();
      return new Map();
    }
    return new Map(
      AXES.map(([key]) => {
        const more = (presses[key] ?? 0) - (before[key] ?? 0);
        return [key, this.#of(key, more, nowMs, held.has(key))];
      }),
    );
  }

  /** @param {string} key @param {number} more presses @param {number} nowMs @param {boolean} isHeld */
  #of(key, more, nowMs, isHeld) {
    const downMs = this.#downMs.get(key);
    if (!isHeld) this.#downMs.delete(key);
    else if (more > 0 || downMs === undefined) {
      this.#downMs.set(key, nowMs);
      more = Math.max(more, 1);
    } else if (nowMs - downMs >= TAP_MS) return 1;
    if (more > 0) {
      const beginMs = Math.max(this.#stepMs.get(key) ?? 0, nowMs);
      this.#stepMs.set(key, Math.min(beginMs + more * TAP_MS, nowMs + 2 * TAP_MS));
    }
    return nowMs < (this.#stepMs.get(key) ?? 0) ? this.#share : 0;
  }
}

/**
 * What held keys ask for; opposite ones cancel out.
 * @param {Set<string>} held @param {Record<string, number>} presses
 * @param {Map<string, number>} amounts of `Taps` @returns {Asked}
 */
export function askedByKeys(held, presses, amounts) {
  const axes = [...ZERO];
  for (const [key, axis, direction] of AXES) {
    axes[axis] = (axes[axis] ?? 0) + direction * (amounts.get(key) ?? 0);
  }
  const [forward, left, up] = /** @type {Vector} */ (axes);
  return {
    linear: [forward, left, up],
    angular: [-left, forward, up],
    trigger: Number(held.has(DEADMAN)),
    grip: Number(held.has("m")),
    a: held.has("c"),
    b: held.has("o"),
    menu: false,
    presses: [presses["m"] ?? 0, presses["c"] ?? 0, presses["o"] ?? 0, 0],
  };
}

/** A hand that moves as fast as is asked for; it stands still as soon as the deadman is let go. */
export class VirtualHand {
  #speed;
  #turning;
  #rotation;
  /** @type {Vector} */
  #position = ZERO;
  /** @type {Quaternion} */
  #turn = [0, 0, 0, 1];
  #linear = ZERO;
  #angular = ZERO;
  /** @type {number | null} */
  #lastMs = null;

  /**
   * @param {{ speed_m_s: number, turn_rad_s: number }} desk
   * @param {readonly (readonly number[])[]} rotation of the tracking frame to the arm's base frame
   */
  constructor(desk, rotation) {
    this.#speed = desk.speed_m_s;
    this.#turning = desk.turn_rad_s;
    this.#rotation = rotation;
  }

  /**
   * The pose now, in the tracking frame: position [m] and quaternion.
   * @param {number} nowMs @param {Asked} asked @returns {number[]}
   */
  step(nowMs, asked) {
    const gapMs = nowMs - (this.#lastMs ?? nowMs);
    this.#lastMs = nowMs;
    if (asked.trigger <= 0 || gapMs > LONGEST_GAP_MS) this.#linear = this.#angular = ZERO;
    else this.#go(gapMs / 1000, asked);
    return [...this.#position, ...this.#turn];
  }

  /** @param {number} interval [s] @param {Asked} asked */
  #go(interval, asked) {
    const change = interval / RAMP_S;
    // two axes at once are no faster than one
    const linear = times(shortened(asked.linear), this.#speed);
    const angular = times(shortened(asked.angular), this.#turning);
    this.#linear = towards(this.#linear, linear, this.#speed * change);
    this.#angular = towards(this.#angular, angular, this.#turning * change);
    const way = this.#inTrackingFrame(times(this.#linear, interval));
    this.#position = plus(this.#position, way);
    this.#turn = turned(this.#turn, this.#inTrackingFrame(times(this.#angular, interval)));
  }

  /** The rotation's transpose, applied. @param {Vector} vector @returns {Vector} */
  #inTrackingFrame(vector) {
    const column = (/** @type {number} */ place) =>
      vector.reduce((sum, one, row) => sum + one * (this.#rotation[row]?.[place] ?? 0), 0);
    return [column(0), column(1), column(2)];
  }
}

/** @param {Vector} a @param {number} factor @returns {Vector} */
const times = ([x, y, z], factor) => [x * factor, y * factor, z * factor];

/** @param {Vector} a @param {Vector} b @returns {Vector} */
const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];

/** At most of length 1. @param {Vector} a */
const shortened = (a) => times(a, 1 / Math.max(1, Math.hypot(...a)));

/** `a`, nearer to `goal`. @param {Vector} a @param {Vector} goal @param {number} most */
function towards(a, goal, most) {
  const way = plus(goal, times(a, -1));
  const size = Math.hypot(...way);
  return size <= most ? goal : plus(a, times(way, most / size));
}

/**
 * `turn`, then the rotation vector `vector` [rad] of the parent frame.
 * @param {Quaternion} turn @param {Vector} vector @returns {Quaternion}
 */
function turned([bx, by, bz, bw], vector) {
  const angle = Math.hypot(...vector);
  const [ax, ay, az] = times(vector, angle > 1e-9 ? Math.sin(angle / 2) / angle : 0.5);
  const aw = Math.cos(angle / 2);
  const x = aw * bx + ax * bw + ay * bz - az * by;
  const y = aw * by - ax * bz + ay * bw + az * bx;
  const z = aw * bz + ax * by - ay * bx + az * bw;
  const w = aw * bw - ax * bx - ay * by - az * bz;
  const size = Math.hypot(x, y, z, w);
  return [x / size, y / size, z / size, w / size];
}
