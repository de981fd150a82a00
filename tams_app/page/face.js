/** What the page shows beside the views: banner, figures, where the arm is. */

import { minutes } from "./words.js";

/**
 * @typedef {import("./messages.js").SessionState} SessionState
 * @typedef {import("./messages.js").SessionDescription} SessionDescription
 */

/** The element that carries this name. @param {string} name @returns {HTMLElement} */
export function part(name) {
  const found = document.querySelector(`[data-tams="${name}"]`);
  if (found === null) throw new Error(`the page has no part ${name}`);
  return /** @type {HTMLElement} */ (found);
}

/** @param {string} name @param {string} text */
export function write(name, text) {
  writeInto(part(name), text);
}

/** @param {import("./words.js").Banner} banner @param {string} arming */
export function showBanner({ look, sentence, key }, arming) {
  const { dataset, style } = document.documentElement;
  dataset["state"] = arming;
  style.setProperty("--look", look.colour);
  style.setProperty("--look-ink", look.ink);
  style.setProperty("--look-border", look.border);
  write("sign", look.sign);
  write("state", look.word);
  write("reason", sentence);
  write("key", key);
}

/**
 * @param {import("./words.js").Words} words @param {string[]} headings
 * @param {SessionDescription} session @param {SessionState} state
 */
export function showFigures(words, headings, session, state) {
  write("phase", state.phase || "–");
  write("time", minutes(state.t_s));
  const where = `strategy ${session.strategy}, network ${session.network.split("/").at(-1)}`;
  write("session", `${session.name} · ${where}${session.simulated ? " · simulated" : ""}`);
  for (const [place, text] of words.uplink(state).entries()) {
    write(["load", "queue", "slowest"][place] ?? "", text);
  }
  write("episodes", words.episodes(state));
  const views = Object.entries(state.views);
  const [head, body] = part("rates").children;
  if (!head || !body) return;
  fill(head, [headings], "tr", "th");
  fill(body, views.map(([name, view]) => words.row(name, view, state.asked_fps)), "tr", "td");
  for (const [place, [name]] of views.entries()) {
    body.children[place]?.setAttribute("data-tams", `rates-${name}`);
    body.children[place]?.classList.toggle("primary", name === state.primary_view);
  }
  listed(part("hand"), words.hand(state));
}

/** Names and words as a list. @param {Element} list @param {string[][]} pairs */
export function listed(list, pairs) {
  fill(list, pairs, "div", "dt", "dd");
}

/**
 * The arm's workspace [mm] from above, x up and y to the left, and at the side the TCP's height.
 * @param {Record<string, any>} space `SessionDescription.workspace` @param {SessionState} state
 */
export function showWhere(space, { tcp_mm: tcp }) {
  const [[lowX, lowY, lowZ], [highX, highY, highZ]] = [space["box_min_mm"], space["box_max_mm"]];
  const [wide, tall] = [highY - lowY, highX - Math.min(lowX, 0) + 20];
  const set = (/** @type {string} */ name, /** @type {Record<string, number | string>} */ values) => {
    for (const [key, value] of Object.entries(values)) {
      document.querySelector(`#above ${name}`)?.setAttribute(key, String(value));
    }
  };
  document.querySelector("#above")?.setAttribute("viewBox", `${-highY} ${-highX} ${1.15 * wide} ${tall}`);
  const box = { x: -highY, y: -highX, width: wide, height: highX - lowX };
  set(".space", { ...box, viewBox: `${box.x} ${box.y} ${wide} ${box.height}` });
  set(".far", { r: space["radius_max_mm"] });
  set(".near", { r: space["radius_min_mm"] });
  set(".box", box);
  set(".beam", { x: -lowY + 0.06 * wide, y: -highX, width: 0.05 * wide, height: tall });
  set(".tcp", { visibility: tcp === null ? "hidden" : "visible" });
  if (tcp === null) return;
  const share = Math.min(Math.max((tcp[2] - lowZ) / (highZ - lowZ), 0), 1);
  set(".tcp line", { x2: -tcp[1], y2: -tcp[0] });
  set(".tcp circle", { cx: -tcp[1], cy: -tcp[0] });
  set(".tcp rect", { x: -lowY + 0.04 * wide, y: -highX + (1 - share) * tall - 5, width: 0.09 * wide });
}

/**
 * Rows of cells, of these kinds in turn; what is there already is used.
 * @param {Element} into @param {string[][]} texts @param {string} row @param {string[]} kinds
 */
function fill(into, texts, row, ...kinds) {
  const count = texts.length;
  while (into.childElementCount > count) into.lastElementChild?.remove();
  while (into.childElementCount < count) into.append(document.createElement(row));
  for (const [place, cells] of texts.entries()) {
    const parent = into.children[place];
    for (const [at, text] of cells.entries()) {
      if (parent && !parent.children[at]) {
        parent.append(document.createElement(kinds[at % kinds.length] ?? "span"));
      }
      writeInto(parent?.children[at], text);
    }
  }
}

/** Only what is new. @param {Element | undefined} element @param {string} text */
function writeInto(element, text) {
  if (element && element.textContent !== text) element.textContent = text;
}
