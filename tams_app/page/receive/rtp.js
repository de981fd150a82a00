/**
 * RTP packets (RFC 3550): the fixed numbers of our streams, reading of packets, resent ones.
 *
 * As in `tams_app/video/core/packets.py`; the golden logs of `tests/page` hold both to the same.
 */

export const SEQUENCES = 2 ** 16;
export const TIMESTAMPS = 2 ** 32;
export const TICKS_PER_MS = 90;

const FIRST_MEDIA = 0x54410000;
const FIRST_PARITY = 0x54420000;
const FIRST_PADDING = 0x54430000;
const FIRST_RECEIVER = 0x54440000;
const VERSION = 2;
const HEADER_BYTES = 12;
const WORD_BYTES = 4;
const EXTENDED = 0x10;
const ONE_BYTE_EXTENSIONS = 0xbede; // RFC 8285
const TRANSPORT_SEQUENCE = 0x11; // extension 1, of two bytes, as our senders write it

/**
 * @typedef {object} RtpPacket
 * @property {boolean} marker the last packet of a frame
 * @property {number} sequence 16 bits
 * @property {number} timestamp 32 bits, of a clock of 90 kHz
 * @property {number} ssrc which of the view's streams it is of
 * @property {number | null} transportSequence its number among all packets of the view's session
 * @property {Uint8Array} payload
 */

/** The SSRCs of a view's streams. @param {number} place in the configuration, from 0 */
export function viewSsrcs(place) {
  return {
    media: FIRST_MEDIA + 2 * place,
    repair: FIRST_MEDIA + 2 * place + 1,
    parity: FIRST_PARITY + place,
    padding: FIRST_PADDING + place,
    receiver: FIRST_RECEIVER + place,
  };
}

/**
 * The place of the view that a sender's packet, of RTP or RTCP, is of; null: of none.
 * @param {Uint8Array} bytes
 */
export function placeOf(bytes) {
  const at = isRtcp(bytes) ? 4 : 8;
  if (bytes.length < at + WORD_BYTES) return null;
  const ssrc = dataView(bytes).getUint32(at);
  const place = ssrc % SEQUENCES;
  if (ssrc - place === FIRST_MEDIA) return place >> 1;
  return [FIRST_PARITY, FIRST_PADDING].includes(ssrc - place) ? place : null;
}

/** By what stands where RTP has marker and type (RFC 5761). @param {Uint8Array} bytes */
export function isRtcp([, type = 0]) {
  return type >= 192 && type <= 223;
}

/**
 * Null if the bytes are no RTP packet.
 * @param {Uint8Array} bytes @returns {RtpPacket | null}
 */
export function readRtp(bytes) {
  if (bytes.length < HEADER_BYTES) return null;
  const view = dataView(bytes);
  const first = view.getUint8(0);
  if (first >> 6 !== VERSION) return null;
  let offset = HEADER_BYTES + WORD_BYTES * (first & 0x0f); // contributing sources
  let transportSequence = null;
  if (first & EXTENDED) {
    if (bytes.length < offset + 2 * WORD_BYTES) return null;
    const isNumber = view.getUint8(offset + WORD_BYTES) === TRANSPORT_SEQUENCE;
    if (view.getUint16(offset) === ONE_BYTE_EXTENSIONS && isNumber) {
      transportSequence = view.getUint16(offset + WORD_BYTES + 1);
    }
    offset += WORD_BYTES * (1 + view.getUint16(offset + 2));
  }
  if (offset > bytes.length) return null;
  return {
    marker: (view.getUint8(1) & 0x80) !== 0,
    sequence: view.getUint16(2),
    timestamp: view.getUint32(4),
    ssrc: view.getUint32(8),
    transportSequence,
    payload: bytes.subarray(offset),
  };
}

/**
 * The packet that a resent one (RFC 4588) carries, as it first was; null if it carries none.
 * @param {RtpPacket} resent @param {number} ssrc of the media stream @returns {RtpPacket | null}
 */
export function original(resent, ssrc) {
  if (resent.payload.length < 2) return null;
  const sequence = dataView(resent.payload).getUint16(0);
  return { ...resent, sequence, ssrc, payload: resent.payload.subarray(2) };
}

/**
 * A number of so many values, counted on through their wraps: the one nearest to `reference`.
 * @param {number} reference @param {number} value @param {number} modulus
 */
export function nearest(reference, value, modulus) {
  const step = remainder(value - reference, modulus);
  return reference + (step >= modulus / 2 ? step - modulus : step);
}

/** @param {number} value @param {number} modulus */
export function remainder(value, modulus) {
  return ((value % modulus) + modulus) % modulus;
}

/**
 * Capture time [ms] of the frame with an RTP timestamp, `firstMs` being that of timestamp 0.
 * @param {number} timestamp @param {number} firstMs
 * @param {number} nearMs less than 6 hours from it: gives how often the timestamps have wrapped
 */
export function captureMs(timestamp, firstMs, nearMs) {
  const near = Math.round((nearMs - firstMs) * TICKS_PER_MS);
  return firstMs + nearest(near, timestamp, TIMESTAMPS) / TICKS_PER_MS;
}

/** @param {Uint8Array} bytes */
export function dataView(bytes) {
  return new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
}
