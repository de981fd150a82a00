import assert from "node:assert/strict";
import { test } from "node:test";

import { PacketOrder } from "../../tams_app/page/receive/order.js";
import { readRtp } from "../../tams_app/page/receive/rtp.js";
import { rtp } from "./packets.js";

const WAIT_MS = 50;

/** @param {number} sequence @param {number} [timestamp] */
function packet(sequence, timestamp = 0) {
  const read = readRtp(rtp({ sequence, timestamp }));
  assert(read !== null);
  return read;
}

/** @param {PacketOrder} order @param {number} nowMs */
function numbers(order, nowMs) {
  return order.take(nowMs).map(({ packet, isAfterGap }) => (isAfterGap ? -1 : 1) * packet.sequence);
}

/** @param {number[]} sequences that come at once */
function begun(...sequences) {
  const order = new PacketOrder(WAIT_MS);
  for (const sequence of sequences) order.add(0, packet(sequence));
  return order;
}

test("packets leave in order, once each, whatever order they come in", () => {
  assert.deepEqual(numbers(begun(0, 2, 1, 1, 4, 3, 0), 0), [0, 1, 2, 3, 4]);
});

test("the order goes on where the numbers wrap", () => {
  const order = begun(65534, 65535, 1, 0);
  assert.deepEqual(numbers(order, 0), [-65534, 65535, 0, 1], "it did not see the stream begin");
});

test("what is missing is asked for once, when the next packet shows it", () => {
  const order = begun(0, 1, 4);
  assert.deepEqual(order.takeRequests(), [2, 3]);
  order.add(1, packet(5));
  assert.deepEqual(order.takeRequests(), []);
});

test("what has come by the time of asking is not asked for", () => {
  const order = begun(0, 3);
  order.fill(0, packet(1));
  assert.deepEqual(order.takeRequests(), [2]);
});

test("a missing packet is waited for as long as the rule says, then the next shows the gap", () => {
  const order = begun(0, 2, 3);
  assert.deepEqual(numbers(order, WAIT_MS - 1), [0]);
  assert.equal(order.nextMs, WAIT_MS);
  assert.deepEqual(numbers(order, WAIT_MS), [-2, 3]);
  assert.equal(order.nextMs, Infinity);
  order.add(WAIT_MS, packet(1));
  assert.deepEqual(numbers(order, WAIT_MS), [], "it comes too late");
});

test("each gap has its own wait, which counts from when it shows", () => {
  const order = begun(0, 2);
  order.add(30, packet(4));
  assert.deepEqual(numbers(order, WAIT_MS), [0, -2]);
  assert.equal(order.nextMs, 30 + WAIT_MS);
  order.fill(WAIT_MS, packet(3));
  assert.deepEqual(numbers(order, WAIT_MS), [3, 4]);
});

test("a restored end of a frame is taken before anything shows that it is missing", () => {
  const order = begun(0, 1);
  order.fill(0, packet(2));
  assert.deepEqual(numbers(order, 0), [0, 1, 2]);
});

test("of a cut longer than the sender keeps packets, nothing is asked for or waited for", () => {
  const order = begun(0);
  order.add(1100, packet(9, 90 * 1100));
  assert.deepEqual(order.takeRequests(), []);
  assert.deepEqual(numbers(order, 1100), [-9]);
  const shorter = begun(0);
  shorter.add(900, packet(3, 90 * 900));
  assert.deepEqual(shorter.takeRequests(), [1, 2]);
});

test("a silence in which the numbers may have wrapped counts as a gap", () => {
  const order = begun(0);
  order.add(2900, packet(1, 90 * 2900));
  order.add(6000, packet(2, 90 * 6000));
  assert.deepEqual(numbers(order, 6000), [-2]);
});

test("a pause without a loss is no gap", () => {
  const order = new PacketOrder(WAIT_MS);
  order.add(0, packet(0, 90 * 60_000));
  order.add(2900, packet(1, 90 * 62_900));
  assert.deepEqual(numbers(order, 2900), [0, 1]);
});

test("two packets in a row far away are a stream that starts anew, one is none", () => {
  for (const [first, away] of [
    [5, 20_000],
    [40_000, 3],
  ]) {
    assert(first !== undefined && away !== undefined);
    const order = begun(first);
    numbers(order, 0);
    order.add(1, packet(away));
    order.add(1, packet(first + 1));
    assert.deepEqual(numbers(order, 1), [first + 1]);
    order.add(2, packet(away + 1));
    assert.deepEqual(numbers(order, 2), [-(away + 1)]);
  }
});

test("resent packets that come far too late start no stream", () => {
  const order = begun(1000);
  numbers(order, 0);
  for (const sequence of [700, 701, 702, 9000, 9001]) order.fill(1, packet(sequence));
  order.add(1, packet(1001));
  assert.deepEqual(numbers(order, 1), [1001]);
});
