import assert from "node:assert/strict";
import { test } from "node:test";

import { Depacketizer } from "../../tams_app/page/receive/h264.js";
import { readRtp } from "../../tams_app/page/receive/rtp.js";
import { rtp } from "./packets.js";

const [SPS, PPS, IDR, SLICE] = [[0x67, 1], [0x68, 2], [0x65, 3, 4], [0x41, 5, 6, 7]];

/** @param {number[][]} units */
function annexB(...units) {
  return units.flatMap((unit) => [0, 0, 0, 1, ...unit]);
}

/** @param {number[][]} units */
function aggregate(...units) {
  return [0x78, ...units.flatMap((unit) => [0, unit.length, ...unit])];
}

/**
 * The frames that come of packets of one frame, the last of them marked.
 * @param {number[][]} payloads @param {number} [gapAt] which of them follows a gap
 */
function frames(payloads, gapAt = -1) {
  const depacketizer = new Depacketizer();
  return payloads.flatMap((payload, place) => {
    const marker = place === payloads.length - 1;
    const packet = readRtp(rtp({ sequence: place, marker, payload }));
    assert(packet !== null);
    return depacketizer.add(packet, place === gapAt);
  });
}

/** @param {number[][]} payloads */
function only(payloads) {
  const [frame, ...others] = frames(payloads);
  assert(frame !== undefined && others.length === 0);
  return { ...frame, data: [...frame.data] };
}

test("NAL units come whole, in aggregates and in fragments, and leave behind start codes", () => {
  const fragments = [[0x7c, 0x85, 3], [0x7c, 0x05], [0x7c, 0x45, 4]];
  const frame = only([aggregate(SPS ?? [], PPS ?? []), ...fragments, SLICE ?? []]);
  assert.deepEqual(frame.data, annexB(SPS ?? [], PPS ?? [], IDR ?? [], SLICE ?? []));
  assert(frame.isComplete && frame.isKeyframe);
});

test("a keyframe is what has a slice of an IDR picture, not what has parameter sets", () => {
  assert(!only([aggregate(SPS ?? [], PPS ?? []), SLICE ?? []]).isKeyframe);
  assert(only([aggregate(SPS ?? [], IDR ?? [])]).isKeyframe);
  assert(!only([SLICE ?? []]).isKeyframe);
});

test("a frame with a gap before or in it is incomplete, and the next is not", () => {
  for (const gapAt of [0, 1]) {
    const [frame] = frames([SLICE ?? [], SLICE ?? []], gapAt);
    assert.equal(frame?.isComplete, false);
  }
  const depacketizer = new Depacketizer();
  const next = [0, 1].flatMap((place) => {
    const packet = readRtp(rtp({ sequence: place, timestamp: place, payload: SLICE ?? [] }));
    assert(packet !== null);
    return depacketizer.add(packet, place === 0);
  });
  assert.deepEqual(next.map((frame) => frame.isComplete), [false, true]);
});

test("what is left of a frame without its end leaves when the next begins, incomplete", () => {
  const depacketizer = new Depacketizer();
  const came = [false, true].flatMap((marker, place) => {
    const what = { sequence: place, timestamp: 9 * place, marker };
    const packet = readRtp(rtp({ ...what, payload: SLICE ?? [] }));
    assert(packet !== null);
    return depacketizer.add(packet, false);
  });
  const verdicts = came.map((frame) => [frame.timestamp, frame.isComplete]);
  assert.deepEqual(verdicts, [[0, false], [9, true]]);
});

for (const [name, payloads] of /** @type {[string, number[][]][]} */ ([
  ["a fragment without its start", [[0x7c, 0x45, 4]]],
  ["a start without its end", [[0x7c, 0x85, 3]]],
  ["a start after a start", [[0x7c, 0x85, 3], [0x7c, 0x85, 3], [0x7c, 0x45, 4]]],
  ["a slice between fragments", [[0x7c, 0x85, 3], [0x41, 5], [0x7c, 0x45, 4]]],
  ["an aggregate of nothing", [[0x78], [0x78, 0, 0]]],
  ["an aggregate that is cut off", [[0x78, 0, 9, 1]]],
  ["an aggregate without room for a length", [[0x78, 0, 1, 0x65, 0]]],
  ["a kind that is never sent", [[0x79, 0, 0, 1, 2]]],
  ["no content", [[]]],
  ["a fragment without a header", [[0x7c]]],
])) {
  test(`${name} makes no complete frame`, () => assert(!only(payloads).isComplete));
}
