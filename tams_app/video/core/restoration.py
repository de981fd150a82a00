"""Packets that parity restored, inferred from the fates of all: receivers do not report."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.video.core.packets import SEQUENCES

_NEVER_NS = 1 << 62


def restored_packets(packets: Iterable[PacketRecord]) -> list[PacketRecord]:
    """The restored packets, as resent ones that arrived when they were restored.

    A frame's parity packets name their groups: as many as they are, interleaved (`parity`).
    """
    parity: dict[tuple[str, int], list[PacketRecord]] = defaultdict(list)
    media: dict[tuple[str, int], dict[int, PacketRecord]] = defaultdict(dict)
    arrived_ns: dict[tuple[str, int, int], int] = {}
    for packet in packets:
        frame = (packet.view, packet.rtp_timestamp)
        if packet.kind is PacketKind.PARITY:
            parity[frame].append(packet)
        elif packet.kind in (PacketKind.MEDIA, PacketKind.REPAIR):
            if packet.kind is PacketKind.MEDIA:
                media[frame][packet.sequence] = packet
            key, at_ns = (*frame, packet.sequence), packet.delivered_ns or _NEVER_NS
            arrived_ns[key] = min(at_ns, arrived_ns.get(key, _NEVER_NS))
    found = []
    for frame, several in parity.items():
        for one in several:
            group = [
                (arrived_ns[(*frame, sequence)], sequence)
                for sequence in media[frame]
                if (sequence - one.sequence) % SEQUENCES % len(several) == 0
                and (sequence - one.sequence) % SEQUENCES < SEQUENCES // 2
            ]
            if not group:  # the log does not have them
                continue
            *others, last = sorted(group)
            known_ns = max([one.delivered_ns or _NEVER_NS, *(at_ns for at_ns, _ in others)])
            if known_ns < last[0]:
                lost = media[frame][last[1]]
                found.append(
                    replace(
                        lost,
                        kind=PacketKind.REPAIR,
                        size_bytes=0,
                        delivered_ns=known_ns,
                        fate=PacketFate.DELIVERED,
                    )
                )
    return found
