import assert from "node:assert/strict";
import { test } from "node:test";

import { captureMs, placeOf, viewSsrcs } from "../../tams_app/page/receive/rtp.js";
import { ViewReceiver } from "../../tams_app/page/receive/view_receiver.js";
import { FRAME_TICKS, SSRCS, asked, resent, rtcpOf, rtp } from "./packets.js";

/** @typedef {import("../../tams_app/page/receive/rule.js").RepairRule} RepairRule */

/** @type {RepairRule} */
const RESENT = {
  rtx: true,
  latencyMs: 80,
  pliIntervalMs: 300,
  pli: true,
  parity: false,
  longestWaitMs: Infinity,
};
const UNREPAIRED = { ...RESENT, rtx: false, latencyMs: 20 };
const FRAME_MS = FRAME_TICKS / 90;
const IDR = [0x65, 1, 2];

/** A receiver of frames of one packet each, 30 a second. */
class Stream {
  /** @type {boolean[]} which were whole, of those handed out */
  whole = [];
  /** @type {Uint8Array[]} */
  rtcp = [];

  /** @param {RepairRule} rule @param {boolean} [feedback] */
  constructor(rule, feedback = false) {
    this.receiver = new ViewReceiver(0, rule, feedback);
  }

  /** @param {number} index @param {number[]} [payload] */
  frame(index, payload) {
    const what = { sequence: index % 65536, timestamp: (FRAME_TICKS * index) % 2 ** 32 };
    const packet = payload === undefined ? what : { ...what, payload };
    this.take(index * FRAME_MS, rtp({ ...packet, transport: index }));
  }

  /** @param {number} nowMs @param {Uint8Array} bytes */
  take(nowMs, bytes) {
    this.keep(this.receiver.receive(nowMs, bytes));
  }

  /** @param {import("../../tams_app/page/receive/view_receiver.js").Outcome} outcome */
  keep({ units, rtcp }) {
    this.whole.push(...units.map((unit) => unit.isWhole));
    this.rtcp.push(...rtcp);
  }

  /** What was asked for since the last call. */
  asked() {
    return asked(this.rtcp.splice(0));
  }
}

/** @param {number} word */
function bytesOf(word) {
  return [24, 16, 8, 0].map((shift) => (word >>> shift) & 0xff);
}

test("before the first keyframe nothing is whole, and one is asked for at once", () => {
  const stream = new Stream(UNREPAIRED);
  stream.frame(7);
  assert(stream.asked().keyframe);
  stream.frame(8, IDR);
  stream.frame(9);
  assert.deepEqual(stream.whole, [false, true, true]);
  assert(!stream.asked().keyframe);
});

test("a stream that does not begin with a keyframe is not whole, though all of it is here", () => {
  const stream = new Stream(UNREPAIRED);
  stream.frame(0);
  assert.deepEqual(stream.whole, [false]);
  assert(stream.asked().keyframe);
});

test("who sees the stream begin asks for no keyframe", () => {
  const stream = new Stream(UNREPAIRED);
  stream.frame(0, IDR);
  stream.frame(1);
  assert.deepEqual(stream.whole, [true, true]);
  assert.deepEqual(stream.asked(), { numbers: [], keyframe: false });
});

test("a loss breaks the chain until a complete keyframe", () => {
  const stream = new Stream(UNREPAIRED);
  stream.frame(0, IDR);
  stream.frame(2);
  assert.equal(stream.receiver.nextMs, 2 * FRAME_MS + 20);
  stream.keep(stream.receiver.poll(2 * FRAME_MS + 20));
  stream.frame(3);
  stream.frame(4, IDR);
  stream.frame(5);
  assert.deepEqual(stream.whole, [true, false, false, true, true]);
  const { numbers, keyframe } = stream.asked();
  assert(keyframe);
  assert.deepEqual(numbers, [], "nothing is resent under this rule");
});

test("a packet that is resent in time leaves the chain whole", () => {
  const stream = new Stream(RESENT);
  stream.frame(0, IDR);
  stream.frame(2);
  assert.deepEqual(stream.asked(), { numbers: [1], keyframe: false });
  stream.take(2 * FRAME_MS + 60, resent({ sequence: 1, timestamp: FRAME_TICKS }));
  stream.frame(5);
  assert.deepEqual(stream.whole, [true, true, true]);
  assert.deepEqual(stream.asked().numbers, [3, 4]);
});

test("keyframes are asked for again after two intervals, and after one if more is lost", () => {
  for (const [lost, times] of /** @type {[number[], number[]][]} */ ([
    [[1], [2, 20, 38, 56]],
    [[1, 4], [2, 11, 29, 47]],
  ])) {
    const stream = new Stream({ ...UNREPAIRED, latencyMs: 0 });
    stream.frame(0, IDR);
    const plis = [];
    for (let index = 1; index < 60; index++) {
      if (!lost.includes(index)) stream.frame(index);
      if (stream.asked().keyframe) plis.push(index);
    }
    assert.deepEqual(plis, times);
  }
});

test("a rule without keyframe requests asks for none", () => {
  const stream = new Stream({ ...UNREPAIRED, latencyMs: 0, pli: false });
  stream.frame(0, IDR);
  stream.frame(2);
  assert(!stream.asked().keyframe);
});

test("the rarer the frames, the longer a missing packet is waited for, up to the longest", () => {
  for (const [longestWaitMs, waitMs] of [
    [Infinity, 80 + 66],
    [100, 100],
  ]) {
    assert(longestWaitMs !== undefined && waitMs !== undefined);
    const stream = new Stream({ ...RESENT, longestWaitMs }, true);
    for (const index of [0, 1, 2, 3, 5]) {
      const packet = rtp({ sequence: index, timestamp: 9000 * index, payload: IDR });
      stream.take(index * 100, packet);
    }
    stream.keep(stream.receiver.poll(500 + waitMs - 1));
    assert.equal(stream.whole.length, 4);
    stream.keep(stream.receiver.poll(500 + waitMs));
    assert.equal(stream.whole.length, 5);
  }
});

test("numbers, timestamps and those of the session are followed through their wraps", () => {
  const stream = new Stream(RESENT, true);
  const first = 2 ** 32 / FRAME_TICKS - 5;
  for (let index = 0; index < 10; index++) {
    const timestamp = Math.floor((first + index) * FRAME_TICKS) % 2 ** 32;
    const sequence = (65532 + index) % 65536;
    const payload = index === 0 ? [0x41, 0] : index === 1 ? IDR : [0x41, index];
    stream.take(index * FRAME_MS, rtp({ sequence, timestamp, payload, transport: 65530 + index }));
  }
  assert.deepEqual(stream.whole, [false, ...Array(9).fill(true)]);
  assert.deepEqual(stream.asked().numbers, []);
});

test("frames of one stream have ticks that rise through the wrap of the timestamps", () => {
  const receiver = new ViewReceiver(0, UNREPAIRED, false);
  const ticks = [2 ** 32 - 3000, 0, 3000].flatMap((timestamp, sequence) =>
    receiver.receive(sequence, rtp({ sequence, timestamp })).units.map((unit) => unit.ticks),
  );
  assert.deepEqual(ticks.map((one) => one - (ticks[0] ?? 0)), [0, 3000, 6000]);
});

test("the sender's report is answered with how long ago it came", () => {
  const stream = new Stream(UNREPAIRED);
  stream.frame(0, IDR);
  /** @param {number} ssrc @param {number} ntp the middle of the time */
  const report = (ssrc, ntp) => {
    const words = [ssrc, ntp >>> 16, ntp << 16, 0, 0, 0];
    return [0x80, 200, 0, 6, ...words.flatMap(bytesOf)];
  };
  const others = report(SSRCS.repair, 0x99999999);
  stream.take(20, Uint8Array.from([...others, ...report(SSRCS.media, 0x12345678), ...others]));
  stream.keep(stream.receiver.poll(50));
  const [block] = rtcpOf(stream.rtcp);
  assert.equal(block?.type, 201);
  assert.deepEqual(block?.words.slice(-2), [0x12345678, Math.round((30 * 65536) / 1000)]);
});

test("reports come at their times though nothing else does", () => {
  for (const [feedback, everyMs] of /** @type {[boolean, number][]} */ ([
    [false, 50],
    [true, 500],
  ])) {
    const { receiver } = new Stream(UNREPAIRED, feedback);
    assert.equal(receiver.nextMs, Infinity);
    receiver.receive(7, rtp({ sequence: 0, payload: IDR }));
    for (const nowMs of [7 + everyMs, 7 + 2 * everyMs]) {
      assert.equal(receiver.nextMs, nowMs);
      assert.deepEqual(rtcpOf(receiver.poll(nowMs).rtcp).map(({ type }) => type), [201, 202]);
    }
  }
});

test("other views' packets change nothing", () => {
  const stream = new Stream(UNREPAIRED);
  stream.frame(0, IDR);
  const outcome = stream.receiver.receive(1, rtp({ sequence: 9, ssrc: viewSsrcs(1).media }));
  assert.deepEqual(outcome, { units: [], rtcp: [] });
  stream.frame(1);
  assert.deepEqual(stream.whole, [true, true]);
});

test("a packet tells which view it is of", () => {
  for (const place of [0, 1, 2]) {
    const { receiver, ...ssrcs } = viewSsrcs(place);
    for (const ssrc of Object.values(ssrcs)) {
      assert.equal(placeOf(rtp({ sequence: 0, ssrc })), place);
    }
    assert.equal(placeOf(rtp({ sequence: 0, ssrc: receiver })), null);
    const report = Uint8Array.of(0x80, 200, 0, 1, ...bytesOf(ssrcs.media));
    assert.equal(placeOf(report), place);
  }
  assert.equal(placeOf(new Uint8Array(11)), null);
});

test("a timestamp tells when its frame was captured, however often it has wrapped", () => {
  assert.equal(captureMs(90 * 40, 1000, 1500), 1040);
  const dayMs = 24 * 3600 * 1000;
  assert.equal(captureMs((90 * dayMs) % 2 ** 32, 1e9, 1e9 + dayMs + 5000), 1e9 + dayMs);
  assert.equal(captureMs(2 ** 32 - 90, 1000, 1000), 999);
});

test("no bytes whatsoever make it throw", () => {
  let state = 12345;
  /** @param {number} below */
  const random = (below) => ((state = (state * 48271) % (2 ** 31 - 1)) >> 7) % below;
  const stream = new Stream({ ...RESENT, parity: true }, true);
  for (let turn = 0; turn < 20_000; turn++) {
    const ssrc = Object.values(SSRCS)[random(5)] ?? 0;
    const what = { sequence: turn >> 3, timestamp: turn >> 5, ssrc, transport: turn };
    const payload = Array.from({ length: random(30) }, () => random(256));
    const bytes = rtp({ ...what, payload, marker: random(4) === 0 });
    if (random(4) === 0) bytes.set([0x80, 200 + random(7), 0, random(9)]);
    if (random(2) === 0) bytes[random(bytes.length)] = random(256);
    stream.take(turn, random(3) === 0 ? bytes.subarray(0, random(bytes.length)) : bytes);
    stream.keep(stream.receiver.poll(turn));
  }
  assert(stream.whole.length > 100, `${stream.whole.length}`);
});
