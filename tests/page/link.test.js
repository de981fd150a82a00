import assert from "node:assert/strict";
import { createHmac, webcrypto } from "node:crypto";
import { test } from "node:test";

import { RobotClock, resolution } from "../../tams_app/page/clock.js";
import { APPLICATION, LINK, Unframer, framed, isMedia } from "../../tams_app/page/messages.js";
import { pack, unpack } from "../../tams_app/page/msgpack.js";
import { StreamMessages, prefixed, prove, readFragment } from "../../tams_app/page/proof.js";
import { codecOf } from "../../tams_app/page/view_stream.js";

globalThis.crypto ??= /** @type {any} */ (webcrypto); // node 18 has no global one

const bytes = (/** @type {number[]} */ ...values) => Uint8Array.from(values);
const filledBytes = (/** @type {number} */ size, /** @type {number} */ value) => new Uint8Array(size).fill(value);

test("what is packed is unpacked as it was", () => {
  const values = [null, true, false, 0, 127, 128, 2 ** 32 - 1, 2 ** 32, 2 ** 53 - 1, -1, -(2 ** 40)];
  for (const value of [...values, 0.5, -1e-9, Infinity, "", "Ångström", 2n ** 61n, [1, [2, "x"]]]) {
    assert.deepEqual(unpack(pack(value)), value);
  }
  assert.deepEqual([...unpack(pack(bytes(1, 2, 3)))], [1, 2, 3]);
  assert.deepEqual({ ...unpack(pack({ type: "Proof", key: 3 })) }, { type: "Proof", key: 3 });
});

test("bytes that are no value, or more than one, are refused", () => {
  for (const wrong of [bytes(), bytes(0xc1), bytes(0xd9, 5, 65), bytes(1, 2), bytes(0xa1, 0xff), filledBytes(40, 0x91)]) {
    assert.throws(() => unpack(wrong), RangeError);
  }
  assert.throws(() => pack(undefined), RangeError);
  assert.throws(() => pack(new Uint8Array(5000)), RangeError);
});

test("a message fills its size, whatever is in it, and comes out as it was", () => {
  for (const length of [0, 1, 200, 256]) {
    const datagram = framed(APPLICATION, 7, filledBytes(length, 9));
    assert.equal(datagram.length, 7 + 256);
    assert.equal(new Unframer().take(datagram)?.content.length, length);
  }
  assert.equal(framed(LINK, 1, bytes(1)).length, 7 + 64);
});

test("a message that was overtaken, is cut or of no known kind is refused", () => {
  const unframer = new Unframer();
  assert.equal(unframer.take(framed(APPLICATION, 2, bytes(2)))?.kind, APPLICATION);
  assert.equal(unframer.take(framed(APPLICATION, 2, bytes(2))), null);
  assert.equal(unframer.take(framed(LINK, 1, bytes(1))), null);
  assert.equal(unframer.take(framed(APPLICATION, 3, filledBytes(90, 3)).subarray(0, 60)), null);
  assert.equal(unframer.take(framed(5, 4, bytes(4))), null);
  assert.equal(unframer.take(bytes(1, 0)), null);
  assert.equal(unframer.take(framed(LINK, 5, bytes(5)))?.kind, LINK);
});

test("RTP and RTCP are told from messages by the first byte", () => {
  assert.deepEqual([127, 128, 191, 192].map((first) => isMedia(bytes(first))), [false, true, true, false]);
});

const code = filledBytes(16, 5);
const door = { identity: filledBytes(32, 1), certificate: filledBytes(32, 2) };
const nonce = filledBytes(32, 3);
const content = Uint8Array.from([0, 2, 65, 66, 0, 0, 0]); // "AB", filled up

/** @param {Uint8Array} key @param {(Uint8Array | string)[]} parts */
function mac(key, ...parts) {
  const made = createHmac("sha256", key);
  for (const part of parts) made.update(part);
  return new Uint8Array(made.digest());
}

/**
 * A robot that answers as `answer` makes of the proof; what became of it.
 * @param {(proof: any) => unknown} answer @param {Uint8Array} [challenge]
 */
async function proved(answer, challenge = pack({ type: "Challenge", nonce })) {
  /** @type {Uint8Array[]} */
  const said = [];
  const next = async () => (said.length === 0 ? challenge : pack(answer(unpack(said[0] ?? bytes()))));
  const say = async (/** @type {Uint8Array} */ message) => void said.push(message);
  return prove(code, door, "page", { next, say });
}

/** @param {any} proof @param {Uint8Array} [key] */
function welcome(proof, key = code) {
  const about = [door.identity, door.certificate, nonce, proof.nonce];
  assert.deepEqual(proof.mac, mac(code, "TAMS operator", ...about, proof.introduction));
  assert.deepEqual(proof.key, mac(code, "TAMS page name").slice(0, 8));
  assert.equal(proof.introduction.length, 2 + 256);
  return { type: "Welcome", content, mac: mac(key, "TAMS robot", ...about, content), again: bytes(8) };
}

test("a robot that knows the code welcomes the page, which gets a code of its own", async () => {
  const found = await proved((proof) => welcome(proof));
  assert.deepEqual(found, { description: bytes(65, 66), again: bytes(8) });
});

test("a busy robot is told from one that does not know the code", async () => {
  assert.equal(await proved(() => ({ type: "Busy" })), null);
  await assert.rejects(proved((proof) => welcome(proof, filledBytes(16, 6))), RangeError);
  await assert.rejects(proved((proof) => ({ ...welcome(proof), mac: bytes(1) })), RangeError);
  await assert.rejects(proved(() => ({ type: "Welcome" })), RangeError);
  await assert.rejects(proved(welcome, pack({ type: "Challenge", nonce: bytes(1) })), RangeError);
});

test("messages of a stream are put together, however they were cut", async () => {
  const whole = [...prefixed(bytes()), ...prefixed(filledBytes(300, 7)), ...prefixed(bytes(1))];
  for (const size of [1, 2, 3, 299, 1000]) {
    const stream = new ReadableStream({
      start(controller) {
        for (let at = 0; at < whole.length; at += size) controller.enqueue(bytes(...whole.slice(at, at + size)));
        controller.close();
      },
    });
    const messages = new StreamMessages(stream);
    const lengths = [await messages.next(), await messages.next(), await messages.next()].map((one) => one.length);
    assert.deepEqual(lengths, [0, 300, 1]);
    await assert.rejects(messages.next(), RangeError);
  }
});

test("a link's fragment has a code of 128 bits, and perhaps a certificate", () => {
  const encoded = (/** @type {Uint8Array} */ one) => Buffer.from(one).toString("base64url");
  const certificate = filledBytes(32, 255);
  assert.deepEqual(readFragment(`#${encoded(code)}`), { code, certificate: null });
  assert.deepEqual(readFragment(`#${encoded(code)}.${encoded(certificate)}`), { code, certificate });
  for (const wrong of ["", "#", "#abc", `#${encoded(certificate)}`, "#%%%"]) assert.equal(readFragment(wrong), null);
});

test("the robot's clock is known from exchanges, within the fastest round trip", () => {
  const clock = new RobotClock();
  assert.equal(clock.offsetNs, null);
  const offset = 5e9;
  for (const [at, there, back] of /** @type {[number, number, number][]} */ ([[1e9, 40e6, 10e6], [2e9, 5e6, 80e6]])) {
    const [heard, received] = [at + there + offset, at + there + back + 1e6];
    clock.step(at, heard, heard + 1e6, received);
  }
  assert.ok(Math.abs((clock.offsetNs ?? 0) - offset) <= (clock.roundTripMs ?? 0) * 1e6);
  assert.ok(Math.abs((clock.roundTripMs ?? 0) - 15) < 1);
});

test("an exchange that contradicts what is known voids it, and those begun before", () => {
  const clock = new RobotClock();
  clock.step(1e9, 11e9, 11e9, 1.01e9);
  clock.step(2e9, 22e9, 22e9, 2.01e9); // the robot's clock was set
  assert.equal(clock.offsetNs, null);
  clock.step(1.9e9, 21.9e9, 22.1e9, 2.1e9);
  assert.equal(clock.offsetNs, null);
  clock.step(3e9, 23e9, 23e9, 3.01e9);
  assert.ok(Math.abs((clock.offsetNs ?? 0) - 20e9) < 10e6);
});

test("an echo that cannot be ours says nothing", () => {
  const clock = new RobotClock();
  for (const echo of [0, -1, 5e9]) clock.step(echo, 1e9, 1e9, 2e9);
  assert.equal(clock.offsetNs, null);
});

for (const step of [0.005, 1, 100]) {
  test(`the step of a clock that counts in ${step} ms is found`, () => {
    let calls = 0;
    assert.ok(Math.abs(resolution(() => Math.floor(calls++ / 7) * step) - step) < 1e-9);
  });
}

test("the decoder is chosen by the stream's own parameter set", () => {
  const parameters = bytes(0, 0, 0, 1, 0x67, 0x42, 0xc0, 0x1e, 0x8c);
  assert.equal(codecOf(parameters), "avc1.42c01e");
  assert.equal(codecOf(bytes(0, 0, 1, 0x65, 1, 2, 3, 4)), null);
  assert.equal(codecOf(bytes()), null);
});
