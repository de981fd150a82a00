"""The same two sides in virtual time: a trial in one thread of one process.

Live, threads and processes hand things to each other; here one queue of events says what is due.
What is modelled of the time that things take, besides network and jitter buffer (measured live on
the machine of docs/MEASUREMENTS.md, medians):

| from | to | takes |
|---|---|---|
| instant of a frame | handed to the sender | `side.DELIVERY_NS`, 12 ms |
| handed over | first packet on the link | `shared.ENCODING_NS`, 4.5 ms |
| access unit out of the jitter buffer | on the screen | `shared.DECODING_NS`, 2.5 ms |
| arm's report | control loop | none; reports come at 100 Hz as live |
| command of a tick | arm's controller | none; live: half of an SDK round trip of 0.4 ms |
| phase begins | targets at the senders | none; live: waking a thread |

No tick, frame or packet is ever late for want of a processor, there is no guard process (nothing
for it to watch), and load and memory of a machine are not recorded: null in summary.json.
"""
