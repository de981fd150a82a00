"""Frames whose errors the decoder concealed: inferred from packet loss.

A frame is incomplete when one of its packets did not come in time: it did not arrive, was not
resent, and was not restored by parity. It is concealed when it is incomplete or predicted from a
concealed frame: up to the next complete keyframe. All other frames are bit-exact; a concealed one
may be, where the lost packet carried nothing new (repeated parameter sets). Logs and summaries call
concealed frames `damaged`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import pairwise

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.video.core.packets import SEQUENCES

_NEVER_NS = 1 << 62


def concealed_frames(
    keyframe_of: Mapping[int, bool],
    packets: Iterable[PacketRecord],
    shown_ns: Mapping[int, int],
    index_of: Mapping[int, int],
) -> set[int]:
    """Capture indices of the concealed frames of one view, shown or not.

    Args:
        keyframe_of: every frame sent, by index: whether it is a keyframe.
        packets: the view's datagrams with their fates.
        shown_ns: when frames were shown, by index; a packet that arrives after its frame or a
            later one was shown is too late.
        index_of: the frames' indices by RTP timestamp; other packets are left out.
    """
    packets = list(packets)
    video = [
        packet
        for packet in (*packets, *restored_packets(packets))
        if packet.kind in (PacketKind.MEDIA, PacketKind.REPAIR) and packet.rtp_timestamp in index_of
    ]
    incomplete = _incomplete(set(keyframe_of), video, shown_ns, index_of)
    found, concealed = set(), True  # nothing can be predicted before the first keyframe
    for index in sorted(keyframe_of):
        concealed = index in incomplete or (concealed and not keyframe_of[index])
        if concealed:
            found.add(index)
    return found


def _incomplete(
    sent: set[int],
    video: list[PacketRecord],
    shown_ns: Mapping[int, int],
    index_of: Mapping[int, int],
) -> set[int]:
    """Frames of which a packet is missing or too late, or never came to the link at all."""
    arrived_ns: dict[tuple[int, int], int] = {}  # RTP timestamp and sequence: a lap apart differ
    for packet in video:
        key = (packet.rtp_timestamp, packet.sequence)
        at_ns = packet.delivered_ns or _NEVER_NS
        arrived_ns[key] = min(at_ns, arrived_ns.get(key, _NEVER_NS))
    last_ns: dict[int, int] = {}  # when a frame's last packet arrived
    for (timestamp, _), at_ns in arrived_ns.items():
        index = index_of[timestamp]
        last_ns[index] = max(at_ns, last_ns.get(index, 0))
    deadline_ns, found = _NEVER_NS, sent - last_ns.keys()
    for index in sorted(last_ns.keys() | shown_ns.keys(), reverse=True):
        deadline_ns = min(deadline_ns, shown_ns.get(index, _NEVER_NS))
        if last_ns.get(index, 0) >= deadline_ns:
            found.add(index)
    return found | _beside_gaps(video, index_of)


def _beside_gaps(video: list[PacketRecord], index_of: Mapping[int, int]) -> set[int]:
    """Frames on both sides of a gap in the sequence numbers: lost on the way to the link."""
    media = sorted(
        (packet for packet in video if packet.kind is PacketKind.MEDIA),
        key=lambda packet: packet.entered_ns,
    )
    found: set[int] = set()
    for before, after in pairwise(media):
        if 1 < (after.sequence - before.sequence) % SEQUENCES < SEQUENCES // 2:
            found |= {index_of[one.rtp_timestamp] for one in (before, after)}
    return found


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
