/** A call to the robot: a connection by WebTransport, on which the page proves its code. */

import { framed } from "./messages.js";
import { StreamMessages, prefixed, prove } from "./proof.js";

const ATTEMPT_MS = 5000;
const OLDEST_MS = 50; // of what waits to be sent
const WAITING = 64; // datagrams of feedback
const INTRODUCTION = ""; // of a folder: nothing is recorded here
/** Sentences for the operator, each with what to do. */
const NO_ANSWER =
  "The robot does not answer: see that it runs, that UDP reaches it, and that this is its newest link.";
const REFUSED = "The robot does not accept this link: open the newest one that it printed.";
const BUSY = "Another operator is connected, or was a moment ago: waiting until they leave.";

/**
 * @typedef {import("./proof.js").Door & { url: string }} Address where and what the robot is
 * @typedef {{ transport: WebTransport, welcome: import("./proof.js").Welcome }} Call
 */

/** Why a call came to nothing, in a sentence for the operator. */
export class CallError extends Error {}

/**
 * Calls the robot; CallError if nothing comes of it.
 * @param {Address} address @param {Uint8Array} code @returns {Promise<Call>}
 */
export async function call(address, code) {
  const transport = new WebTransport(address.url, {
    serverCertificateHashes: [{ algorithm: "sha-256", value: address.certificate.slice() }],
    congestionControl: "low-latency",
  });
  transport.closed.catch(() => undefined); // who uses it hears of it by its streams
  let sentence = NO_ANSWER;
  const timer = setTimeout(() => transport.close(), ATTEMPT_MS);
  try {
    await transport.ready;
    sentence = REFUSED;
    const welcome = await proven(transport, address, code);
    if (welcome !== null) return { transport, welcome };
    sentence = BUSY;
  } catch {
    // what the browser tells of a failure is not for people: the sentence is
  } finally {
    clearTimeout(timer);
  }
  transport.close();
  throw new CallError(sentence);
}

/** @param {WebTransport} transport @param {Address} address @param {Uint8Array} code */
async function proven(transport, address, code) {
  const { readable, writable } = await transport.createBidirectionalStream();
  const [messages, writer] = [new StreamMessages(readable), writable.getWriter()];
  const say = (/** @type {Uint8Array} */ message) => writer.write(prefixed(message));
  return prove(code, address, INTRODUCTION, { next: () => messages.next(), say });
}

/** What leaves in datagrams: of messages the newest, feedback behind, nothing that is old. */
export class Outgoing {
  #writer;
  #isBusy = false;
  #number = 0;
  /** @type {Map<number, Uint8Array>} by kind */
  #messages = new Map();
  /** @type {Uint8Array[]} */
  #feedback = [];

  /** @param {WebTransport} transport */
  constructor({ datagrams }) {
    datagrams.outgoingMaxAge = OLDEST_MS;
    // browsers have one or the other
    const writable = datagrams.writable ?? /** @type {any} */ (datagrams).createWritable();
    /** @type {WritableStreamDefaultWriter<Uint8Array>} */
    this.#writer = writable.getWriter();
    this.#writer.closed.catch(() => undefined); // who reads hears of it
  }

  /** @param {number} kind @param {Uint8Array} content */
  message(kind, content) {
    this.#messages.set(kind, content);
    void this.#send();
  }

  /** @param {Uint8Array[]} datagrams */
  feedback(datagrams) {
    this.#feedback.push(...datagrams);
    this.#feedback.splice(0, this.#feedback.length - WAITING);
    void this.#send();
  }

  async #send() {
    if (this.#isBusy) return;
    this.#isBusy = true;
    for (let next = this.#next(); next !== undefined; next = this.#next()) {
      const isSent = await this.#writer.write(next).then(() => true, () => false);
      if (!isSent) return; // the connection is closed, and what it had to send is forgotten
    }
    this.#isBusy = false;
  }

  /** What is to be sent first; a message gets its number now, so that none is late. */
  #next() {
    const [first] = this.#messages;
    if (first === undefined) return this.#feedback.shift();
    this.#messages.delete(first[0]);
    return framed(first[0], ++this.#number, first[1]);
  }
}
