/** Keys that are down, and what a key asks for; pure. */

/** By `KeyboardEvent.code`: what a key is called is another matter in each country. */
const HAND = {
  KeyW: "w", KeyS: "s", KeyA: "a", KeyD: "d", KeyR: "r", KeyF: "f", KeyM: "m", KeyC: "c", KeyO: "o",
  ShiftLeft: "shift", ShiftRight: "shift",
};
/** @type {Record<string, string>} */
const COMMANDS = {
  Enter: "confirm", NumpadEnter: "confirm", Space: "stop", Escape: "stop", KeyQ: "leave",
  KeyE: "next", PageDown: "next", KeyZ: "discard", PageUp: "discard", KeyU: "redo",
  KeyY: "success", KeyN: "failure", Tab: "swap", F1: "help",
};
const DIGIT = /^(?:Digit|Numpad)([1-9])$/;
const HELD = new Map(Object.entries(HAND));

/**
 * @typedef {{ shiftKey: boolean, ctrlKey: boolean, altKey: boolean, metaKey: boolean }} Modifiers
 * @typedef {Modifiers & { code: string, repeat: boolean }} KeyPress as of a `KeyboardEvent`
 */

/**
 * What a press asks for: a command, `pin 1` and so on; "" for nothing.
 *
 * A stop counts also where the key repeats itself; whatever is held beside it.
 * @param {KeyPress} press
 */
export function commandOf(press) {
  const command = COMMANDS[press.code] ?? "";
  if (command === "stop") return command;
  if (press.repeat || press.ctrlKey || press.altKey || press.metaKey) return "";
  const digit = DIGIT.exec(press.code);
  return digit ? `pin ${digit[1]}` : command;
}

/**
 * The keys of the hand. A press counts once, until its release; none without `focus`.
 *
 * Shift counts only while the events say that it is down. Beside Control, Alt or Command nothing is
 * held: macOS keeps releases back while Command is down.
 */
export class Keys {
  /** @type {Map<string, string>} by code */
  #held = new Map();
  /** @type {Record<string, number>} how often each has gone down, by name */
  presses = {};
  #hasFocus = false;
  #hasShift = false;

  /** The names of those that are down. */
  get held() {
    return new Set(this.#held.values());
  }

  /** Shift is down but does not count: it must be released and pressed again. */
  get shiftIsDead() {
    return this.#hasFocus && this.#hasShift && !this.held.has("shift");
  }

  /** @param {boolean} hasFocus without it no release is seen, so no key is held */
  focus(hasFocus) {
    if (hasFocus === this.#hasFocus) return;
    this.#hasFocus = hasFocus;
    this.#held.clear();
    this.#hasShift = this.#hasShift && hasFocus;
  }

  /** @param {KeyPress} press */
  press(press) {
    this.modifiers(press);
    const name = HELD.get(press.code);
    if (!this.#hasFocus || name === undefined || press.repeat || this.#held.has(press.code)) return;
    if (press.ctrlKey || press.altKey || press.metaKey) return;
    this.#held.set(press.code, name);
    this.presses = { ...this.presses, [name]: (this.presses[name] ?? 0) + 1 };
  }

  /** @param {KeyPress} release */
  release(release) {
    this.#held.delete(release.code);
    this.modifiers(release);
  }

  /** What any event says of them. @param {Modifiers} event */
  modifiers({ shiftKey, ctrlKey, altKey, metaKey }) {
    this.#hasShift = shiftKey;
    if (ctrlKey || altKey || metaKey) this.#held.clear();
    if (shiftKey) return;
    this.#held.delete("ShiftLeft");
    this.#held.delete("ShiftRight");
  }
}
