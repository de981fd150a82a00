/** Prints what the page makes of what `test_page.py` gives it: `node told.js FILE`. */

import { readFileSync } from "node:fs";

import { Taps, VirtualHand, askedByKeys } from "../../tams_app/page/hand.js";
import { decodeDescription, decodeState, encodeHand } from "../../tams_app/page/messages.js";
import { Words, asKnown } from "../../tams_app/page/words.js";

const { tables, states, held, hands, description } = JSON.parse(readFileSync(process.argv[2] ?? "", "utf-8"));
const bytes = (/** @type {string} */ encoded) => new Uint8Array(Buffer.from(encoded, "base64"));

/** @param {any} one */
function told({ message, hand, shiftIsDead, silentMs }) {
  const words = new Words(tables, hand);
  const decoded = decodeState(bytes(message));
  const { state, silence } = asKnown(decoded.state, silentMs, tables.liveMs, 500);
  const views = Object.entries(state.views);
  const { look, sentence, key } = words.banner(state, silence, shiftIsDead);
  return {
    decoded,
    banner: [look.word, sentence, key],
    titles: views.map(([name]) => words.title(name, state, name === "gs")),
    rows: views.map(([name, view]) => words.row(name, view, state.asked_fps)),
    uplink: words.uplink(state),
    hand: words.hand(state),
    episodes: words.episodes(state),
  };
}

/** The poses of a hand, tick by tick. */
function moved() {
  const taps = new Taps(tables.desk.speed_m_s);
  const hand = new VirtualHand(tables.desk, held.rotation);
  return held.ticks.map((/** @type {any} */ { ms, keys, presses }) => {
    const down = new Set(/** @type {string[]} */ (keys));
    return hand.step(ms, askedByKeys(down, presses, taps.step(ms, down, presses)));
  });
}

const numbers = (/** @type {string} */ key, /** @type {any} */ value) =>
  typeof value === "string" && /_ns$|^operator$/.test(key) ? BigInt(value) : value;
const encoded = hands.map((/** @type {string} */ one) =>
  Buffer.from(encodeHand(JSON.parse(one, numbers))).toString("base64"),
);
const session = decodeDescription(bytes(description));
const exact = (/** @type {string} */ _, /** @type {any} */ value) =>
  typeof value === "bigint" ? String(value) : value;
console.log(JSON.stringify({ told: states.map(told), poses: moved(), encoded, session }, exact));
