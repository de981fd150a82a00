"""A network of your own, and what it does to a stream of packets.

A network is data: these keys under `networks:` in a YAML file do the same for `tams run --network`.
"""

import statistics

from tams_app.config import load_config
from tams_app.records import PacketFate, PacketKind
from tams_app.units import NS_PER_MS
from tams_app.video.core.link import Link
from tams_app.video.live.networks import network_capacity, resolve_network

LAB = {"latency_ms": 25, "jitter_ms": 5, "loss": 0.01, "loss_burst": 3, "rate_kbps": 4000}
config = load_config(overrides={"networks.lab": LAB})
network = resolve_network(config, "lab")

link = Link(network, network_capacity(network, epoch_ns=0), views=["eih"], seed=1)
records = []
for n in range(3000):  # 1200 bytes every 2 ms are 4800 kbit/s: more than the link carries
    now_ns = n * 2 * NS_PER_MS
    records.append(link.offer(now_ns, "eih", PacketKind.MEDIA, size_bytes=1200, sequence=n))

for fate in PacketFate:
    print(f"{fate.name.lower():<10} {sum(record.fate is fate for record in records):>5} packets")
delays_ms = [
    (record.delivered_ns - record.entered_ns) / NS_PER_MS
    for record in records
    if record.fate is PacketFate.DELIVERED
]
print(
    f"delay      {statistics.median(delays_ms):.0f} ms in the median, {max(delays_ms):.0f} at most"
)
