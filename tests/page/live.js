/**
 * A view's receiver behind a UDP socket, for a test with a real sender.
 *
 * node live.js OPTIONS: JSON with the rule, `feedback`, `senderPort`, and `loseEach`: every
 * so-many-th datagram is lost. Prints its port, then a line of JSON for each frame.
 */

import { createSocket } from "node:dgram";

import { ViewReceiver } from "../../tams_app/page/receive/view_receiver.js";

/**
 * @typedef {object} Options
 * @property {import("../../tams_app/page/receive/rule.js").RepairRule} rule
 * @property {boolean} feedback
 * @property {number} senderPort
 * @property {number} loseEach
 */

/** @type {Options} */
const options = JSON.parse(process.argv[2] ?? "");
const rule = { ...options.rule, longestWaitMs: Infinity };
const receiver = new ViewReceiver(0, rule, options.feedback);
const socket = createSocket("udp4");
/** @type {NodeJS.Timeout | undefined} */
let timer;
let came = 0;

/** @param {import("../../tams_app/page/receive/view_receiver.js").Outcome} outcome */
function obey({ units, rtcp }) {
  for (const datagram of rtcp) socket.send(datagram, options.senderPort, "127.0.0.1");
  for (const { data: _, ...unit } of units) process.stdout.write(`${JSON.stringify(unit)}\n`);
  clearTimeout(timer);
  const waitMs = Math.max(0, receiver.nextMs - performance.now());
  if (waitMs < 60_000) timer = setTimeout(() => obey(receiver.poll(performance.now())), waitMs);
}

socket.on("message", (datagram) => {
  const isLost = ++came % options.loseEach === 0;
  if (!isLost) obey(receiver.receive(performance.now(), new Uint8Array(datagram)));
});
socket.bind(0, "127.0.0.1", () => process.stdout.write(`${socket.address().port}\n`));
process.stdin.on("end", () => process.exit()).resume();
