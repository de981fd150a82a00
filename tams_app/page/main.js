/** The operator's page: puts its parts together. */

import { PageClock, resolution } from "./clock.js";
import { listed, part, showBanner, showFigures, showWhere, write } from "./face.js";
import { commandOf } from "./keys.js";
import { Pictures } from "./pictures.js";
import { fromBase64, readFragment } from "./proof.js";
import { UNKNOWN } from "./messages.js";
import { captureMs } from "./receive/rtp.js";
import { Seat } from "./seat.js";
import { Sight } from "./sight.js";
import { LINK_LOST, Words, asKnown, known } from "./words.js";

/**
 * @typedef {import("./messages.js").SessionDescription} SessionDescription
 *
 * The robot's last state, when it came, and the robot's clock minus ours.
 * @typedef {{ state: import("./messages.js").StateMessage, heardMs: number,
 *   offsetNs: number | null, roundTripMs: number | null }} Heard
 */

const SAMPLE_MS = 1000 / 120;
const FIGURES_MS = 100;
const ASLEEP_MS = 200;
const CODE = "tams-code"; // of this tab: a reload comes back with it
const clock = new PageClock(performance.timeOrigin);
const tables = await (await fetch("tables.json")).json();

/** What this browser lacks, in a sentence; "" if it can do all. */
async function lacks() {
  const browsers = "Chrome, Edge or Chromium from version 114 on has all of it.";
  if (!isSecureContext) return `The page needs HTTPS, or http://localhost. ${browsers}`;
  if (!("WebTransport" in globalThis)) return `This browser has no WebTransport. ${browsers}`;
  if (!("VideoDecoder" in globalThis)) return `This browser has no WebCodecs. ${browsers}`;
  const { supported } = await VideoDecoder.isConfigSupported({ codec: "avc1.42e01e" });
  return supported ? "" : `This browser decodes no H.264. ${browsers}`;
}

/** One operator's page, from the call on. */
class Page {
  #worker = new Worker("worker.js", { type: "module" });
  #resolutionMs = resolution(() => performance.now());
  /** @type {SessionDescription | null} */
  #session = null;
  #sight = new Sight(0, this.#resolutionMs);
  /** @type {Seat | null} */
  #seat = null;
  /** @type {Pictures | null} */
  #pictures = null;
  #words = new Words(tables, "keyboard");
  #hand = "keyboard";
  /** @type {Heard | null} */
  #heard = null;
  /** What was drawn last. @type {{ timestamp: number, drawnMs: number, times: number[] }[]} */
  #drawn = [];
  #noted = 0;
  #hasEntered = false;
  #ended = "";
  #isConnected = false;

  /** @param {import("./call.js").Address} address @param {Uint8Array} code */
  constructor(address, code) {
    this.#worker.addEventListener("message", ({ data }) => this.#take(data));
    this.#worker.addEventListener("error", () => this.#end("The page's worker failed: reload it."));
    const times = { originMs: performance.timeOrigin, resolutionMs: this.#resolutionMs };
    this.#worker.postMessage({ kind: "call", address, code, ...times });
    this.#listen();
    setInterval(() => this.#show(), FIGURES_MS);
    this.#paint();
    this.#beat();
  }

  /** @param {any} data of the worker */
  #take(data) {
    if (data.kind === "welcome") this.#begin(data.description, data.again);
    else if (data.kind === "frame") this.#draw(data);
    else if (data.kind === "state") this.#hear(data);
    else if (data.kind === "unheard") write(this.#session === null ? "call" : "notice", data.sentence);
    else if (data.kind === "lost") this.#isConnected = false;
    else if (data.kind === "left") this.#end("the robot's side has ended the session");
  }

  /** @param {SessionDescription} session @param {Uint8Array} again */
  #begin(session, again) {
    if (again.length > 0) sessionStorage.setItem(CODE, btoa(String.fromCharCode(...again)));
    if (session.protocol !== tables["protocol"]) return this.#end("The page is out of date: reload it.");
    this.#isConnected = true;
    this.#heard = null;
    if (session.session !== this.#session?.session) {
      const { views } = session.video;
      this.#sight = new Sight(views.length, this.#resolutionMs);
      this.#seat = new Seat(tables["desk"], session.hand_rotation, this.#sight);
      this.#pictures = new Pictures(part("views"), session.video, tables["viewColours"]);
      this.#drawn = [];
    }
    this.#session = session;
    write("call", session.simulated ? "A simulated arm." : "A real arm: see that nobody is near it.");
    part("engage").removeAttribute("disabled");
    write("engage", matchMedia("(pointer: coarse)").matches ? "Look on" : "Drive");
    write("enter-note", "Keys drive, a touch screen looks on and stops.");
  }

  /** @param {{ place: number, frame: VideoFrame, timestamp: number, isWhole: boolean }} shown */
  #draw({ place, frame, timestamp, isWhole }) {
    this.#pictures?.draw(place, frame);
    this.#sight.draw(place, timestamp, isWhole);
    this.#worker.postMessage({ kind: "taken", place });
    const [drawnMs, before] = [clock.now(), this.#drawn[place]?.times ?? []];
    const times = [...before.filter((ms) => drawnMs - ms < 1000), drawnMs];
    this.#drawn[place] = { timestamp, drawnMs, times };
  }

  // --- what the operator does --------------------------------------------------------------------

  #listen() {
    const send = () => this.#send(); // at once where the page is left, not with the next sample
    for (const type of ["focus", "blur"]) addEventListener(type, send);
    for (const type of ["visibilitychange", "freeze"]) document.addEventListener(type, send);
    addEventListener("pagehide", () => this.#enter(false));
    addEventListener("keydown", (event) => this.#key(event), { capture: true });
    addEventListener("keyup", (event) => this.#key(event), { capture: true });
    addEventListener("pointermove", (event) => this.#seat?.keys.modifiers(event));
    addEventListener("contextmenu", (event) => event.preventDefault());
    part("stop").addEventListener("pointerdown", () => this.#command("stop", clock.now()));
    part("help").addEventListener("click", () => this.#command("help", clock.now()));
    part("engage").addEventListener("click", () => this.#enter(true));
  }

  /** @param {boolean} hasEntered */
  #enter(hasEntered) {
    this.#hasEntered = hasEntered;
    part("enter").hidden = hasEntered;
    this.#send();
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const command = event.type === "keydown" ? commandOf(event) : "";
    if (command === "stop" || this.#hasEntered) this.#command(command, clock.now() - performance.now() + event.timeStamp);
    if (event.type === "keydown") this.#seat?.keys.press(event);
    else this.#seat?.keys.release(event);
    if (this.#takes(event)) event.preventDefault();
  }

  /** The browser must not do with this key what it does elsewhere. @param {KeyboardEvent} event */
  #takes(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return false;
    if (!this.#hasEntered && event.code !== "Space") return false;
    return commandOf(event) !== "" || event.code === "Tab" || event.code.startsWith("Key");
  }

  /** @param {string} command @param {number} askedMs */
  #command(command, askedMs) {
    const seat = this.#seat;
    const what = command.replace(/ .*/, "");
    const place = Number(command.slice(what.length)) - 1; // of the view to pin
    if (what === "help") return this.#help();
    if (seat === null) return;
    if (what === "stop") seat.stops += 1;
    else if (what === "confirm") seat.confirm(askedMs);
    else if (what === "leave") return this.#end("ended by the operator");
    else if (what === "swap") seat.pinned = this.#pictures?.next ?? null;
    else if (what === "pin" && place < (this.#session?.video.views.length ?? 0)) {
      seat.pinned = seat.pinned === place ? null : place;
    }
    else if (tables["requests"].includes(what)) seat.episode(tables["requests"].indexOf(what));
    else return;
    this.#send();
  }

  #help() {
    const keys = part("keys");
    keys.hidden = !keys.hidden;
    listed(part("key-list"), tables["keys"][this.#hand]);
  }

  // --- what the robot is told --------------------------------------------------------------------

  #send() {
    if (this.#ended !== "") return;
    const isVisible = document.visibilityState === "visible";
    this.#sight.look(this.#hasEntered && isVisible && document.hasFocus());
    const pad = navigator.getGamepads?.().find((one) => one !== null);
    const sample = this.#seat?.sample(clock.now(), pad);
    if (sample !== undefined) this.#worker.postMessage({ kind: "sample", sample });
  }

  #paint() {
    this.#sight.paint(clock.now());
    requestAnimationFrame(() => this.#paint());
  }

  /** A sample 120 times a second. While a computer sleeps one of its two clocks stands still. */
  #beat() {
    let [dueMs, aheadMs] = [clock.now(), Date.now() - clock.now()];
    const tick = () => {
      const nowMs = clock.now();
      const wasAheadMs = aheadMs;
      aheadMs = Date.now() - nowMs;
      if (aheadMs - wasAheadMs > ASLEEP_MS) this.#seat?.wake(nowMs);
      this.#send();
      dueMs = Math.max(dueMs + SAMPLE_MS, nowMs);
      setTimeout(tick, dueMs - clock.now());
    };
    tick();
  }

  // --- what the operator is shown ----------------------------------------------------------------

  #show() {
    const nowMs = clock.now();
    const [heard, session, seat] = [this.#heard, this.#session, this.#seat];
    if (this.#ended !== "" || session === null || heard === null || seat === null) return;
    if (seat.hand !== this.#hand) {
      this.#hand = seat.hand;
      this.#words = new Words(tables, this.#hand);
    }
    const robots = { ...heard.state.state, views: this.#views(heard, session.video.views, nowMs) };
    const { liveMs } = tables;
    const { state, silence } = asKnown(robots, nowMs - heard.heardMs, liveMs, session.stopped_after_ms);
    const shiftIsDead = seat.hand === "keyboard" && seat.keys.shiftIsDead;
    showBanner(this.#words.banner(state, silence, shiftIsDead), state.arming);
    document.documentElement.classList.toggle("silent", silence !== null);
    showFigures(this.#words, tables["headings"], session, state);
    showWhere(session.workspace, state);
    const isLost = !this.#isConnected || state.arming === LINK_LOST;
    write("link", isLost ? "lost" : `round trip ${known(heard.roundTripMs)} ms`);
    if (seat.pad.refusal !== "") write("notice", seat.pad.refusal);
    this.#pictures?.follow(state.primary_view, seat.pinned, nowMs);
    for (const [place, name] of session.video.views.entries()) {
      const title = this.#words.title(name, state, seat.pinned === place);
      const ageMs = state.views[name]?.age_ms ?? null;
      this.#pictures?.title(place, title, ageMs === null || ageMs >= tables["oldMs"]);
    }
  }

  /**
   * The views as the robot knows them, and as they are shown here: the age is that of the frame
   * that counts, the latency that of the newest one.
   * @param {Heard} heard @param {string[]} names @param {number} nowMs
   */
  #views({ state, offsetNs }, names, nowMs) {
    const shown = names.map((name, place) => {
      const drawn = this.#drawn[place];
      const [firstNs, counts] = [state.first_capture_ns[place], this.#sight.seen.shown[place]];
      let age_ms = null;
      let latency_ms = null;
      if (offsetNs !== null && typeof counts === "number" && drawn !== undefined && firstNs !== null) {
        const [firstMs, nearMs] = [Number(firstNs) / 1e6, Number(state.sent_ns) / 1e6];
        const since = (/** @type {number} */ timestamp, /** @type {number} */ ms) =>
          ms + offsetNs / 1e6 - captureMs(timestamp, firstMs, nearMs);
        age_ms = since(counts, nowMs);
        latency_ms = since(drawn.timestamp, drawn.drawnMs);
      }
      const shown_fps = drawn?.times.filter((ms) => nowMs - ms < 1000).length ?? 0;
      return [name, { ...(state.state.views[name] ?? UNKNOWN), age_ms, latency_ms, shown_fps }];
    });
    return Object.fromEntries(shown);
  }

  /** The newest of the robot's sentences stays. @param {Heard} heard */
  #hear(heard) {
    this.#heard = heard;
    const { noted, notes, ended } = heard.state;
    if (noted > this.#noted && notes.length > 0) write("notice", notes.at(-1) ?? "");
    this.#noted = noted;
    if (ended !== "") this.#end(`the robot's side: ${ended}`);
  }

  /** @param {string} sentence */
  #end(sentence) {
    if (this.#ended !== "") return;
    this.#ended = sentence;
    this.#worker.postMessage({ kind: "leave" });
    showBanner({ look: this.#words.look("ended"), sentence, key: "" }, "ended");
    document.documentElement.classList.add("silent");
  }
}

const lack = await lacks();
const given = readFragment(location.hash);
const kept = sessionStorage.getItem(CODE);
const door = await (await fetch("door.json", { cache: "no-store" })).json();
const code = given?.code ?? (kept === null ? null : fromBase64(kept));
if (lack !== "") write("call", lack);
else if (code === null) write("call", "Open the link that the robot printed: this one has no code.");
else {
  sessionStorage.setItem(CODE, btoa(String.fromCharCode(...code)));
  history.replaceState(null, "", location.pathname); // nobody reads the code over a shoulder
  const certificate = given?.certificate ?? fromBase64(door.certificate);
  new Page({ url: door.url, identity: fromBase64(door.identity), certificate }, code);
}
