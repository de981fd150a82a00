/** Packets for tests, and what a test reads of those that a receiver sends. */

import { viewSsrcs } from "../../tams_app/page/receive/rtp.js";

export const SSRCS = viewSsrcs(0);
export const FRAME_TICKS = 3000;
const TYPES = new Map([
  [SSRCS.media, 96],
  [SSRCS.repair, 97],
  [SSRCS.parity, 98],
  [SSRCS.padding, 99],
]);

/**
 * An RTP packet of view 0.
 * @param {{ sequence: number, timestamp?: number, marker?: boolean, ssrc?: number,
 *     transport?: number, payload?: number[] }} what by default a slice that ends its frame
 */
export function rtp({ sequence, timestamp = 0, marker = true, ssrc = SSRCS.media, ...more }) {
  const extension = more.transport === undefined ? [] : [0xbe, 0xde, 0, 1, 0x11, 0, 0, 0];
  const payload = more.payload ?? [0x41, sequence & 0xff];
  const bytes = new Uint8Array(12 + extension.length + payload.length);
  const view = new DataView(bytes.buffer);
  view.setUint8(0, extension.length > 0 ? 0x90 : 0x80);
  view.setUint8(1, (TYPES.get(ssrc) ?? 0) | (marker ? 0x80 : 0));
  view.setUint16(2, sequence % 65536);
  view.setUint32(4, timestamp);
  view.setUint32(8, ssrc);
  bytes.set([...extension, ...payload], 12);
  if (more.transport !== undefined) view.setUint16(17, more.transport % 65536);
  return bytes;
}

/**
 * The packet as it is sent again.
 * @param {Parameters<typeof rtp>[0]} what as it was first sent
 */
export function resent(what) {
  const payload = [what.sequence >> 8, what.sequence & 0xff, ...(what.payload ?? [0x41, 7])];
  return rtp({ ...what, sequence: 0, ssrc: SSRCS.repair, payload });
}

/**
 * The packets of RTCP datagrams.
 * @param {Uint8Array[]} datagrams
 */
export function rtcpOf(datagrams) {
  return datagrams.flatMap((datagram) => {
    const packets = [];
    for (let at = 0; at < datagram.length; ) {
      const view = new DataView(datagram.buffer, datagram.byteOffset + at);
      const length = 4 + 4 * view.getUint16(2);
      packets.push({
        type: view.getUint8(1),
        format: view.getUint8(0) & 0x1f,
        words: [...Array(length / 4 - 1).keys()].map((place) => view.getUint32(4 + 4 * place)),
      });
      at += length;
    }
    return packets;
  });
}

/**
 * The numbers that are asked for, and whether a keyframe is.
 * @param {Uint8Array[]} datagrams
 */
export function asked(datagrams) {
  const packets = rtcpOf(datagrams);
  const numbers = packets
    .filter(({ type, format }) => type === 205 && format === 1)
    .flatMap(({ words }) => words.slice(2).flatMap(named));
  return { numbers, keyframe: packets.some(({ type }) => type === 206) };
}

/** @param {number} entry of a NACK */
function named(entry) {
  const others = [...Array(16).keys()].filter((bit) => (entry >>> bit) & 1);
  return [0, ...others.map((bit) => bit + 1)].map((ahead) => ((entry >>> 16) + ahead) % 65536);
}
