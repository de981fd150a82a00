/**
 * Gives a view's receiver the packets of a log at their times, and prints what comes of them.
 *
 * node replay.js LOG: the log, and what is printed, are JSON; see `packet_logs.py`.
 */

import { readFileSync } from "node:fs";

import { ViewReceiver } from "../../tams_app/page/receive/view_receiver.js";

/**
 * @typedef {object} PacketLog
 * @property {import("../../tams_app/page/receive/rule.js").RepairRule} rule
 * @property {boolean} feedback
 * @property {[number, string][]} packets time [ms] and bytes in base64
 * @property {number} endMs
 */

/** @type {PacketLog} */
const log = JSON.parse(readFileSync(process.argv[2] ?? "", "utf-8"));
const rule = { ...log.rule, longestWaitMs: log.rule.longestWaitMs ?? Infinity };
const receiver = new ViewReceiver(0, rule, log.feedback);
/** @type {object[]} */
const units = [];
/** @type {[number, number, string][]} time, packets that had come, and the datagram */
const rtcp = [];
let came = 0;

/**
 * @param {number} nowMs
 * @param {import("../../tams_app/page/receive/view_receiver.js").Outcome} outcome
 */
function keep(nowMs, outcome) {
  for (const unit of outcome.units) units.push({ ...unit, data: base64(unit.data) });
  for (const datagram of outcome.rtcp) rtcp.push([nowMs, came, base64(datagram)]);
}

/** @param {Uint8Array} bytes */
function base64(bytes) {
  return Buffer.from(bytes).toString("base64");
}

/** @param {number} endMs */
function pollUntil(endMs) {
  for (let dueMs = receiver.nextMs; dueMs <= endMs; dueMs = receiver.nextMs) {
    keep(dueMs, receiver.poll(dueMs));
  }
}

for (const [nowMs, packet] of log.packets) {
  pollUntil(nowMs);
  came++;
  keep(nowMs, receiver.receive(nowMs, new Uint8Array(Buffer.from(packet, "base64"))));
}
pollUntil(log.endMs);
process.stdout.write(JSON.stringify({ units, rtcp }));
