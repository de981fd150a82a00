import assert from "node:assert/strict";
import { test } from "node:test";

import { Keys, commandOf } from "../../tams_app/page/keys.js";
import { Pad, REFUSED } from "../../tams_app/page/pad.js";
import { Seat } from "../../tams_app/page/seat.js";
import { PAINTED_MS, Sight } from "../../tams_app/page/sight.js";

const TICK_MS = 8;
const PLAIN = { repeat: false, shiftKey: false, ctrlKey: false, altKey: false, metaKey: false };
const SHIFT = { ...PLAIN, shiftKey: true };
const DESK = { speed_m_s: 0.12, turn_rad_s: 0.8 };
const UPRIGHT = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

/** An operator at a page that is painted 60 times a second. */
class Operator {
  nowMs = 1000;
  isPainted = true;
  isThere = true;
  /** @type {import("../../tams_app/page/pad.js").PadReading | null} */
  pad = null;

  /** @param {number} [resolutionMs] */
  constructor(resolutionMs = 0) {
    this.sight = new Sight(2, resolutionMs);
    this.seat = new Seat(DESK, UPRIGHT, this.sight);
    this.after(50);
  }

  /** The sample after so long. @param {number} ms */
  after(ms) {
    let sample = this.sample();
    for (const endMs = this.nowMs + ms; this.nowMs < endMs; ) {
      this.nowMs += TICK_MS;
      if (this.isPainted) this.sight.paint(this.nowMs);
      sample = this.sample();
    }
    return sample;
  }

  /** @returns {import("../../tams_app/page/seat.js").Sample} */
  sample() {
    this.sight.look(this.isThere);
    return this.seat.sample(this.nowMs, this.pad);
  }

  /** @param {string[]} codes */
  press(...codes) {
    for (const code of codes) this.seat.keys.press({ ...SHIFT, code });
  }

  /** @param {number} trigger @param {boolean} [isFresh] */
  hold(trigger, isFresh = true) {
    const buttons = Array.from({ length: 17 }, (_, at) => ({ value: at === 7 ? trigger : 0 }));
    const timestamp = isFresh ? this.nowMs : (this.pad?.timestamp ?? 0);
    this.pad = { mapping: "standard", connected: true, timestamp, axes: [0, -1, 0, 0], buttons };
  }
}

test("held keys move the hand, as new as the page was painted", () => {
  const operator = new Operator();
  operator.press("ShiftLeft", "KeyW");
  const sample = operator.after(1000);
  assert.equal(sample.status, "ok");
  assert.equal(sample.trigger, 1);
  assert.ok((sample.pose?.[0] ?? 0) > 0.05);
  assert.equal(sample.pose_ns, operator.nowMs * 1e6);
  assert.equal(sample.buttons_ns, operator.nowMs * 1e6);
});

for (const [what, lose] of /** @type {[string, (operator: Operator) => void][]} */ ([
  ["loses the focus or is hidden", (operator) => (operator.isThere = false)],
  ["is not painted any more", (operator) => (operator.isPainted = false)],
  ["stands still", (operator) => operator.sight.paint((operator.nowMs += 400))],
  ["slept", (operator) => operator.seat.wake(operator.nowMs)],
])) {
  test(`a page that ${what} lets go, until the keys are pressed anew`, () => {
    const operator = new Operator();
    operator.press("ShiftLeft", "KeyW");
    assert.equal(operator.after(100).trigger, 1);
    lose(operator);
    const lost = operator.after(what.includes("painted") ? PAINTED_MS + TICK_MS : 0);
    assert.notEqual(lost.status, "ok");
    assert.deepEqual([lost.trigger, lost.pose], [0, null]);
    operator.isThere = operator.isPainted = true;
    const back = operator.after(300);
    assert.deepEqual([back.status, back.trigger], ["ok", 0]);
    operator.press("ShiftLeft");
    assert.equal(operator.after(50).trigger, 1);
  });
}

for (const resolutionMs of [0, 1, 100]) {
  test(`nothing is held ${PAINTED_MS} ms after the last picture, by a clock in steps of ${resolutionMs} ms`, () => {
    const operator = new Operator(resolutionMs);
    operator.press("ShiftLeft");
    assert.equal(operator.after(40).trigger, 1);
    operator.isPainted = false;
    const paintedMs = operator.nowMs;
    while (operator.after(TICK_MS).trigger > 0) {
      assert.ok(operator.nowMs - paintedMs + resolutionMs <= PAINTED_MS);
      assert.ok(operator.sample().buttons_ns <= (paintedMs + 50) * 1e6);
    }
  });
}

test("a frame counts once the picture with it was taken, and only whole", () => {
  const sight = new Sight(2, 0);
  sight.draw(1, 90, true);
  sight.paint(10);
  assert.deepEqual(sight.seen.shown, [null, null]);
  sight.draw(1, 95, false);
  sight.paint(20);
  assert.deepEqual(sight.seen, { shown: [null, 90], damaged: [false, false] });
  sight.paint(30);
  assert.deepEqual(sight.seen, { shown: [null, 90], damaged: [false, true] });
});

test("what was asked for is counted, also while the page is not seen", () => {
  const operator = new Operator();
  operator.isThere = false;
  operator.seat.stops += 1;
  operator.seat.confirm(990);
  operator.seat.episode(1);
  const { stops, confirms, confirmed_ns, episodes } = operator.after(TICK_MS);
  assert.deepEqual([stops, confirms, confirmed_ns, episodes], [1, 1, 990e6, [0, 1, 0, 0, 0]]);
});

test("a gamepad drives while its time stamp advances, and never by what was held before", () => {
  const operator = new Operator();
  operator.hold(1);
  assert.equal(operator.after(TICK_MS).trigger, 0); // held since before the page
  for (const trigger of [0, 1]) {
    for (let tick = 0; tick < 40; tick++) {
      operator.hold(trigger);
      operator.after(TICK_MS);
    }
  }
  const driving = operator.sample();
  assert.deepEqual([driving.hand, driving.trigger], ["gamepad", 1]);
  assert.ok((driving.pose?.[0] ?? 0) > 0.01);
  operator.hold(1, false);
  assert.equal(operator.after(200).trigger, 0);
  assert.equal(operator.seat.pad.refusal, REFUSED);
  operator.hold(1);
  assert.equal(operator.after(TICK_MS).trigger, 0);
});

test("a pad of an unknown layout drives nothing, and a tremble is no press", () => {
  const pad = new Pad();
  const reading = (/** @type {number} */ grip) => ({
    mapping: "standard", connected: true, timestamp: Math.random(), axes: [],
    buttons: Array.from({ length: 17 }, () => ({ value: grip })),
  });
  assert.equal(pad.step(0, { ...reading(0), mapping: "" }, true), null);
  const presses = [0, 0.7, 0.5, 0.7, 0.3, 0.7].map((grip, at) => pad.step(at, reading(grip), true)?.presses[0]);
  assert.deepEqual(presses, [0, 1, 1, 1, 1, 2]);
});

test("a repeat, a key beside Control, and one without focus are no presses", () => {
  const keys = new Keys();
  keys.press({ ...PLAIN, code: "KeyW" });
  keys.focus(true);
  keys.press({ ...PLAIN, code: "KeyW", repeat: true });
  keys.press({ ...PLAIN, code: "KeyW", ctrlKey: true });
  assert.deepEqual([keys.held, keys.presses], [new Set(), {}]);
  keys.press({ ...PLAIN, code: "KeyW" });
  keys.press({ ...PLAIN, code: "KeyW" });
  assert.deepEqual(keys.presses, { w: 1 });
  keys.modifiers({ ...PLAIN, metaKey: true });
  assert.deepEqual(keys.held, new Set());
});

test("Shift counts while the events say so, and then only once pressed anew", () => {
  const keys = new Keys();
  keys.focus(true);
  keys.press({ ...SHIFT, code: "ShiftLeft" });
  keys.press({ ...SHIFT, code: "ShiftRight" });
  keys.release({ ...SHIFT, code: "ShiftRight" });
  assert.ok(keys.held.has("shift"));
  keys.modifiers(PLAIN); // its release was not seen
  assert.ok(!keys.held.has("shift") && !keys.shiftIsDead);
  keys.modifiers(SHIFT);
  assert.ok(keys.shiftIsDead);
});

test("a stop counts whatever is held beside it, other commands once for each press", () => {
  assert.equal(commandOf({ ...PLAIN, code: "Space", repeat: true, ctrlKey: true }), "stop");
  assert.equal(commandOf({ ...SHIFT, code: "Escape" }), "stop");
  assert.equal(commandOf({ ...PLAIN, code: "Enter" }), "confirm");
  assert.equal(commandOf({ ...PLAIN, code: "Enter", repeat: true }), "");
  assert.equal(commandOf({ ...PLAIN, code: "KeyQ", ctrlKey: true }), "");
  assert.equal(commandOf({ ...PLAIN, code: "Digit2" }), "pin 2");
});
