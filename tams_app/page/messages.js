/**
 * The messages of the link, as `tams_app/link/messages.py` has them, and the datagrams around them.
 *
 * Records keep the names and the order of the fields there; a test compares them.
 */

import { pack, unpack } from "./msgpack.js";

/** @typedef {import("./msgpack.js").Whole} Whole */

/** Of a datagram that is neither RTP nor RTCP, whose first byte is 128 to 191. */
export const APPLICATION = 1;
export const LINK = 2;

const HEAD_BYTES = 7; // kind, number (32 bits), length (16 bits)
// What content is filled up to: its length must not tell what it is.
/** @type {Record<number, number>} */
const SIZES = { [APPLICATION]: 256, [LINK]: 64 };

const HAND_FIELDS = fields(
  "operator simulated sent_ns echo_ns echo_heard_ns status pose pose_ns buttons_ns trigger grip a b menu",
  "shown confirms confirmed_ns stops noted presses hand damaged episodes pinned",
);
const STATE_FIELDS = fields(
  "sent_ns echo_ns echo_heard_ns state first_capture_ns haptics haptic confirms stops noted notes",
  "ended failed",
);
const SESSION_FIELDS = fields(
  "t_s arming reason lasting last_stop deadman orientation_mode gripper_closed hand pressed phase",
  "primary_view tcp_mm views link_kbps budget_kbps capacity_kbps estimate_kbps queue_ms loss",
  "asked_fps now_ns heard_ns episodes placed joints_urad joints_ns speed_scale is_pinned",
  "hottest_motor_c",
);
const VIEW_FIELDS = fields(
  "target_kbps sent_kbps given_fps latency_ms age_ms shown_fps own live_ssim task_live_ssim",
);
const LATENCY_FIELDS = fields("total_ms slowest slowest_ms");
const EPISODES_FIELDS = fields("number doing seconds armed kept discarded last");
const EPISODE_FIELDS = fields("number length_s kept success");

/**
 * @typedef {number | null} Known null: not known
 *
 * @typedef {{ target_kbps: Known, sent_kbps: Known, given_fps: Known, latency_ms: Known,
 *   age_ms: Known, shown_fps: Known, live_ssim: Known, task_live_ssim: Known,
 *   own: { total_ms: number, slowest: string, slowest_ms: number } | null }} ViewState
 *
 * @typedef {{ number: number, doing: string, seconds: number, armed: string, kept: number,
 *   discarded: number, last: { number: number, kept: boolean }[] }} EpisodesState
 *
 * @typedef {{ t_s: number, arming: string, reason: string, lasting: string | null,
 *   last_stop: string, deadman: boolean | null, orientation_mode: boolean,
 *   gripper_closed: boolean | null, hand: string, pressed: string[], phase: string,
 *   primary_view: string, tcp_mm: [number, number, number] | null,
 *   views: Record<string, ViewState>, link_kbps: Known, budget_kbps: Known, capacity_kbps: Known,
 *   estimate_kbps: Known, queue_ms: Known, loss: Known, asked_fps: Known, placed: boolean,
 *   episodes: EpisodesState | null, is_pinned: boolean, hottest_motor_c: Known }} SessionState
 *
 * @typedef {{ sent_ns: Whole, echo_ns: Whole, echo_heard_ns: Whole, state: SessionState,
 *   first_capture_ns: (Whole | null)[], haptics: number, haptic: string, confirms: number,
 *   stops: number, noted: number, notes: string[], ended: string, failed: boolean }} StateMessage
 *
 * @typedef {{ protocol: number, version: string, session: string, name: string, strategy: string,
 *   network: string, feedback: boolean, simulated: boolean, stopped_after_ms: number,
 *   video: { views: string[], width: number, height: number }, repair: Record<string, any>,
 *   hand_rotation: number[][], workspace: Record<string, any> }} SessionDescription
 *
 * @typedef {{ operator: Whole, simulated: boolean, sent_ns: Whole, echo_ns: Whole,
 *   echo_heard_ns: Whole, status: string, pose: number[] | null, pose_ns: number,
 *   buttons_ns: number, trigger: number, grip: number, a: boolean, b: boolean, menu: boolean,
 *   shown: Known[], confirms: number, confirmed_ns: number, stops: number, noted: number,
 *   presses: number[], hand: string, damaged: boolean[], episodes: number[],
 *   pinned: Known }} HandMessage
 */

/** A view of which nothing is known. @type {ViewState} */
export const UNKNOWN = decodeView(VIEW_FIELDS.map(() => null));

/** @param {HandMessage} hand */
export function encodeHand(hand) {
  return pack(HAND_FIELDS.map((name) => hand[/** @type {keyof HandMessage} */ (name)]));
}

/**
 *  The robot's state; RangeError if it is none. @param {Uint8Array} bytes @returns {StateMessage}
 */
export function decodeState(bytes) {
  const message = named(unpack(bytes), STATE_FIELDS);
  const state = named(message.state, SESSION_FIELDS);
  state.views = Object.fromEntries(
    Object.entries(state.views).map(([name, values]) => [name, decodeView(values)]),
  );
  if (state.episodes !== null) {
    const episodes = named(state.episodes, EPISODES_FIELDS);
    const last = [...episodes.last].map((one) => named(one, EPISODE_FIELDS));
    state.episodes = { ...episodes, last };
  }
  return /** @type {any} */ ({ ...message, state });
}

/**
 * The session that the robot runs; RangeError if it is none.
 * @param {Uint8Array} bytes @returns {SessionDescription}
 */
export function decodeDescription(bytes) {
  const found = unpack(bytes);
  if (typeof found?.protocol !== "number") throw new RangeError("no description of a session");
  return found;
}

/**
 * Puts content into a datagram.
 * @param {number} kind @param {number} number only a newer one counts there
 * @param {Uint8Array} content
 */
export function framed(kind, number, content) {
  const { length } = content;
  const datagram = new Uint8Array(HEAD_BYTES + Math.max(length, SIZES[kind] ?? 0));
  const view = new DataView(datagram.buffer);
  view.setUint8(0, kind);
  view.setUint32(1, number);
  view.setUint16(5, length);
  datagram.set(content, HEAD_BYTES);
  return datagram;
}

/** Takes content out of datagrams, each only if it is newer than the last one. */
export class Unframer {
  #newest = 0;

  /**
   * What is in it; null: nothing, or it was overtaken.
   * @param {Uint8Array} datagram @returns {{ kind: number, content: Uint8Array } | null}
   */
  take(datagram) {
    if (datagram.length < HEAD_BYTES) return null;
    const view = new DataView(datagram.buffer, datagram.byteOffset, datagram.byteLength);
    const [kind, number] = [view.getUint8(0), view.getUint32(1)];
    const end = HEAD_BYTES + view.getUint16(5);
    if ((kind !== APPLICATION && kind !== LINK) || end > datagram.length) return null;
    if (number <= this.#newest) return null;
    this.#newest = number;
    return { kind, content: datagram.subarray(HEAD_BYTES, end) };
  }
}

/** @param {Uint8Array} datagram */
export function isMedia(datagram) {
  const first = datagram[0] ?? 0;
  return first >= 128 && first < 192;
}

/** @param {unknown} values @returns {any} */
function decodeView(values) {
  const view = named(values, VIEW_FIELDS);
  return { ...view, own: view.own === null ? null : named(view.own, LATENCY_FIELDS) };
}

/** @param {string[]} lines */
function fields(...lines) {
  return lines.join(" ").split(" ");
}

/**
 * An array as an object; the robot sends all fields.
 * @param {unknown} values @param {string[]} names @returns {Record<string, any>}
 */
function named(values, names) {
  if (!Array.isArray(values) || values.length < names.length) {
    throw new RangeError(`${names.length} fields were expected`);
  }
  return Object.fromEntries(names.map((name, place) => [name, values[place]]));
}
