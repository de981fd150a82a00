/**
 * The link, in a worker, so that it works while the page draws: transport, receivers and decoders.
 *
 * A sample leaves when the page gives one. While the page gives none the worker sends releases, so
 * that the robot holds and says why; what is held it never repeats.
 */

import { CallError, Outgoing, call } from "./call.js";
import { PageClock, RobotClock, toNs } from "./clock.js";
import { APPLICATION, LINK, Unframer, decodeDescription, decodeState } from "./messages.js";
import { encodeHand, isMedia } from "./messages.js";
import { placeOf } from "./receive/rtp.js";
import { released } from "./seat.js";
import { PAINTED_MS } from "./sight.js";
import { ViewStream } from "./view_stream.js";

const BEAT_MS = 1000 / 120;
const REDIAL_MS = 2000;
const [GOODBYE, QUESTION, REPLY] = ["goodbye", "where", "here!"];

/**
 * @typedef {import("./seat.js").Sample} Sample
 * @typedef {import("./messages.js").StateMessage} StateMessage
 * @typedef {{ address: import("./call.js").Address, code: Uint8Array, originMs: number,
 *   resolutionMs: number }} Order the first message from the page
 */

/** One page's link, over as many connections as it takes. */
class Link {
  #address;
  #code;
  #clock;
  #resolutionMs;
  #operator = crypto.getRandomValues(new BigUint64Array(1))[0] ?? 0n;
  /** @type {WebTransport | null} */
  #transport = null;
  /** @type {Outgoing | null} */
  #outgoing = null;
  /** @type {ViewStream[]} */
  #views = [];
  #robotClock = new RobotClock();
  /** @type {StateMessage | null} */
  #state = null;
  #heardMs = 0;
  /** @type {Sample | null} */
  #sample = null;
  #sampleMs = -Infinity;
  #letGo = false;
  #sentNs = 0;
  #hasLeft = false;

  /** @param {Order} order */
  constructor({ address, code, originMs, resolutionMs }) {
    this.#address = address;
    this.#code = code;
    this.#clock = new PageClock(originMs);
    this.#resolutionMs = resolutionMs;
    this.#operator >>= 2n; // whole numbers there are less than 2**62
    setInterval(() => this.#beat(), BEAT_MS);
  }

  /** Calls again and again, until the page leaves. */
  async run() {
    while (!this.#hasLeft) {
      try {
        const { transport, welcome } = await call(this.#address, this.#code);
        if (welcome.again.length > 0) this.#code = welcome.again;
        const description = decodeDescription(welcome.description);
        self.postMessage({ kind: "welcome", description, again: welcome.again });
        await this.#follow(transport, description).finally(() => transport.close());
        self.postMessage({ kind: "lost" });
      } catch (error) {
        const sentence = error instanceof CallError ? error.message : `The page failed: ${error}`;
        self.postMessage({ kind: "unheard", sentence });
      }
      await new Promise((resolve) => setTimeout(resolve, REDIAL_MS));
    }
  }

  /** What was released here stays released until the operator lets go. @param {Sample} sample */
  hand(sample) {
    this.#sample = sample;
    this.#sampleMs = this.#clock.now();
    const isOld = this.#sampleMs - sample.paintedMs + this.#resolutionMs > PAINTED_MS;
    this.#letGo = sample.trigger > 0 && (this.#letGo || isOld);
    this.#send(this.#letGo ? released(sample) : sample);
  }

  /** The page has drawn a frame. @param {number} place */
  taken(place) {
    const view = this.#views[place];
    if (view !== undefined) view.waiting -= 1;
  }

  /** Says goodbye, and calls no more. */
  leave() {
    this.#hasLeft = true;
    if (this.#sample !== null) this.#send(released(this.#sample));
    this.#say(GOODBYE);
    setTimeout(() => this.#transport?.close(), 100);
  }

  /**
   * Until the connection ends.
   * @param {WebTransport} transport @param {import("./messages.js").SessionDescription} description
   */
  async #follow(transport, { video, repair, feedback }) {
    const { rtx, pli, parity, latency_ms, pli_interval_ms, longest_wait_ms } = repair;
    const times = { latencyMs: latency_ms, pliIntervalMs: pli_interval_ms, longestWaitMs: longest_wait_ms };
    const stream = { rule: { rtx, pli, parity, ...times }, feedback };
    this.#views = video.views.map((_, place) => new ViewStream(place, stream, (frame, shown) => {
      self.postMessage({ kind: "frame", place, frame, ...shown }, { transfer: [frame] });
    }));
    this.#robotClock = new RobotClock();
    this.#state = null;
    this.#transport = transport;
    this.#outgoing = new Outgoing(transport);
    const unframer = new Unframer();
    const reader = transport.datagrams.readable.getReader();
    const ended = { value: undefined, done: true }; // a connection may end in an error as well
    for (;;) {
      const { value, done } = await reader.read().catch(() => ended);
      if (done) break;
      const view = isMedia(value) ? this.#views[placeOf(value) ?? -1] : undefined;
      if (view !== undefined) this.#outgoing.feedback(view.receive(this.#clock.now(), value));
      else this.#message(unframer.take(value));
    }
    this.#outgoing = null;
    for (const view of this.#views) view.close();
  }

  /** @param {{ kind: number, content: Uint8Array } | null} message */
  #message(message) {
    if (message === null) return;
    if (message.kind === LINK) return this.#linkSaid(message.content);
    let state;
    try {
      state = decodeState(message.content);
    } catch (error) {
      if (!(error instanceof RangeError)) throw error;
      return; // no state: the newest one there is grows old
    }
    this.#heardMs = this.#clock.now();
    this.#state = state;
    const stamps = [state.echo_ns, state.echo_heard_ns, state.sent_ns, toNs(this.#heardMs)];
    const [echoNs = 0, echoHeardNs = 0, sentNs = 0, heardNs = 0] = stamps.map(Number);
    this.#robotClock.step(echoNs, echoHeardNs, sentNs, heardNs);
    const { offsetNs, roundTripMs } = this.#robotClock;
    self.postMessage({ kind: "state", state, heardMs: this.#heardMs, offsetNs, roundTripMs });
  }

  /** The robot asks whether the page is there, or leaves. @param {Uint8Array} content */
  #linkSaid(content) {
    const said = String.fromCharCode(...content);
    if (said === GOODBYE) self.postMessage({ kind: "left" });
    else if (said.startsWith(QUESTION)) this.#say(REPLY + said.slice(QUESTION.length));
  }

  /** @param {string} said each character a byte */
  #say(said) {
    this.#outgoing?.message(LINK, Uint8Array.from(said, (character) => character.charCodeAt(0)));
  }

  /** Feedback that is due, and a release while the page gives no samples. */
  #beat() {
    const nowMs = this.#clock.now();
    this.#outgoing?.feedback(this.#views.flatMap((view) => view.poll(nowMs)));
    if (this.#sample !== null && nowMs - this.#sampleMs > PAINTED_MS) {
      this.#letGo = true;
      this.#send(released(this.#sample));
    }
  }

  /** @param {Sample} sample */
  #send(sample) {
    if (this.#outgoing === null) return;
    this.#sentNs = Math.max(this.#sentNs + 1, toNs(this.#clock.now()));
    const content = encodeHand({
      ...sample,
      operator: this.#operator,
      simulated: false, // a person holds the keys
      sent_ns: this.#sentNs,
      echo_ns: this.#state?.sent_ns ?? 0,
      echo_heard_ns: toNs(this.#heardMs),
      pose_ns: Math.min(sample.pose_ns, this.#sentNs),
      buttons_ns: Math.min(sample.buttons_ns, this.#sentNs),
      confirmed_ns: Math.min(sample.confirmed_ns, this.#sentNs),
      noted: this.#state?.noted ?? 0,
    });
    this.#outgoing.message(APPLICATION, content);
  }
}

/** @type {Link | null} */
let link = null;

self.addEventListener("message", ({ data }) => {
  if (data.kind === "call") {
    link = new Link(data);
    void link.run();
  } else if (data.kind === "sample") link?.hand(data.sample);
  else if (data.kind === "taken") link?.taken(data.place);
  else if (data.kind === "leave") link?.leave();
});
