import assert from "node:assert/strict";
import { test } from "node:test";

import { ParityDecoder } from "../../tams_app/page/receive/parity.js";
import { readRtp } from "../../tams_app/page/receive/rtp.js";
import { SSRCS, rtp } from "./packets.js";

const FIRST = 65534;
const FRAME = [[1, 2, 3], [4, 5], [6], [7, 8, 9, 10], [11, 12]].map((payload, place) =>
  media(FIRST + place, payload, place === 4),
);

/** @param {number} sequence @param {number[]} payload @param {boolean} marker */
function media(sequence, payload, marker) {
  return read(rtp({ sequence, timestamp: 3000, payload, marker }));
}

/** @param {Uint8Array} bytes */
function read(bytes) {
  const packet = readRtp(bytes);
  assert(packet !== null);
  return packet;
}

/** The parity of each so-many-th packet. @param {number} first @param {number} distance */
function parity(first, distance) {
  const group = FRAME.filter((_, place) => place >= first && (place - first) % distance === 0);
  const sum = [0, 0, 0, 0];
  group.forEach(({ payload }) => payload.forEach((byte, at) => (sum[at] = (sum[at] ?? 0) ^ byte)));
  const number = (FIRST + first) % 65536;
  const markers = group.reduce((all, { marker }) => all ^ Number(marker), 0);
  const length = group.reduce((all, { payload }) => all ^ payload.length, 0);
  const head = [number >> 8, number & 0xff, group.length, distance, markers, 0, length];
  const payload = [...head, ...sum];
  return read(rtp({ sequence: 0, timestamp: 3000, ssrc: SSRCS.parity, payload }));
}

/** A decoder to which these came. @param {number[]} places */
function having(...places) {
  const decoder = new ParityDecoder(SSRCS.media);
  for (const place of places) assert.deepEqual(decoder.media(packetAt(place)), []);
  return decoder;
}

/** @param {number} place */
function packetAt(place) {
  const packet = FRAME[place];
  assert(packet !== undefined);
  return packet;
}

for (const lost of [0, 1, 2, 3, 4]) {
  for (const distance of [1, 2]) {
    test(`packet ${lost} comes back bit for bit from the group of each ${distance}.`, () => {
      const decoder = having(...[0, 1, 2, 3, 4].filter((place) => place !== lost));
      assert.deepEqual(decoder.parity(parity(lost % distance, distance)), [FRAME[lost]]);
      assert.deepEqual(decoder.parity(parity(lost % distance, distance)), [], "once");
      const other = 1 - (lost % distance);
      if (distance === 2) assert.deepEqual(decoder.parity(parity(other, 2)), []);
    });
  }
}

test("of two that miss, one comes back when the other has come", () => {
  const decoder = having(2, 3, 4);
  assert.deepEqual(decoder.parity(parity(0, 1)), []);
  assert.deepEqual(decoder.media(packetAt(1)), [FRAME[0]]);
});

test("another frame's packets of the same numbers stand for none", () => {
  const decoder = having(1, 2, 3, 4);
  decoder.media({ ...packetAt(0), timestamp: 6000 });
  assert.deepEqual(decoder.parity(parity(0, 1)), [FRAME[0]]);
});

test("what is no parity of ours restores nothing", () => {
  const { payload, ...others } = parity(0, 1);
  const longer = Uint8Array.from(payload);
  longer[5] = 1; // a length of 256 more
  assert.deepEqual(having(1, 2, 3, 4).parity({ ...others, payload: longer }), []);
  assert.deepEqual(having(1, 2, 3, 4).parity({ ...others, payload: payload.subarray(0, 6) }), []);
});

test("what is kept has a bound", () => {
  const decoder = having(1, 2, 3, 4);
  for (let number = 0; number < 1024; number++) {
    decoder.media({ ...packetAt(0), sequence: number, timestamp: 9000 });
  }
  assert.deepEqual(decoder.parity(parity(0, 1)), []);
});
