import assert from "node:assert/strict";
import { test } from "node:test";

import { RepairWait } from "../../tams_app/page/receive/rule.js";

const RULE = { rtx: true, latencyMs: 80, pliIntervalMs: 300, pli: true, parity: false };

for (const [name, capturesMs, waitMs] of /** @type {[string, number[], number][]} */ ([
  ["at 30 frames a second, or more, for the latency", [0, 16, 33, 50], 80],
  ["before a second frame for the latency", [7], 80],
  ["longer where frames are rarer, by their median", [0, 100, 400, 600], 80 + 166],
  ["by the last three", [0, 10, 20, 30, 130, 430, 630], 80 + 166],
  ["by no more than where there are four a second", [0, 400, 800, 1200], 80 + 216],
])) {
  test(`a missing packet is waited for ${name}`, () => {
    const wait = new RepairWait({ ...RULE, longestWaitMs: Infinity });
    assert.equal(capturesMs.map((ms) => wait.after(ms)).at(-1), waitMs);
    const bounded = new RepairWait({ ...RULE, longestWaitMs: 90.5 });
    assert.equal(capturesMs.map((ms) => bounded.after(ms)).at(-1), Math.min(waitMs, 90));
    const unasked = new RepairWait({ ...RULE, rtx: false, longestWaitMs: Infinity });
    assert.equal(capturesMs.map((ms) => unasked.after(ms)).at(-1), 80);
  });
}
