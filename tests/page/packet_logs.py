"""Golden packet logs: what came to a receiver in virtual time, and what it made of that.

The receiver is the product's, with GStreamer's jitter buffer and depayloader; encoder, link and
resends are real or modelled as in any run in virtual time. `replay.js` gives the page's receive
path the same packets at the same times.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from typing import Any
from unittest.mock import patch

from tams_app import gst
from tams_app.config import Network, VideoConfig
from tams_app.records import Frame, PacketKind, PacketRecord
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.link import Link
from tams_app.video.core.packets import REPAIR_PAYLOAD_TYPE, read_rtp, repair_ssrc
from tams_app.video.core.receiver import WholeChain
from tams_app.video.core.repair import RepairRule
from tams_app.video.virtual.rtcp_sessions import Feedback
from tams_app.video.virtual.video import VirtualVideo
from tests.video.scenes import frame
from tests.video.virtual_time.runs import START_NS, Run, make

VIEW = "eih"
START_CODE, LENGTH_BYTES = b"\0\0\0\1", 4
PARAMETER_SETS = {7, 8}


@dataclass(frozen=True)
class Unit:
    """An access unit that a receiver handed out; the data are Annex B."""

    received_ms: float
    timestamp: int
    is_whole: bool
    data: bytes


@dataclass
class PacketLog:
    """One view's packets [ms, datagram] and what the product's receiver made of them."""

    rule: RepairRule
    packets: list[tuple[float, bytes]] = field(default_factory=list)
    units: list[Unit] = field(default_factory=list)
    told: list[Feedback] = field(default_factory=list)
    end_ms: float = 0.0

    @property
    def whole(self) -> dict[int, Unit]:
        return {unit.timestamp: unit for unit in self.units if unit.is_whole}

    @property
    def nacks(self) -> dict[int, float]:
        """When each packet was asked for first [ms], by its number."""
        return first_times((one.sent_ns / NS_PER_MS, one.nacks) for one in self.told)

    @property
    def plis_ms(self) -> list[float]:
        return [one.sent_ns / NS_PER_MS for one in self.told if one.pli]

    @property
    def arrivals(self) -> dict[int, int]:
        """When each packet of the session came [ns], as it was reported, by its number there."""
        messages = (message for one in self.told for message in one.arrivals)
        return {n: ns for message in messages for n, ns in message.arrived_ns.items()}


class ReorderingLink(Link):
    """A link on which every so-many-th media packet comes later than those behind it."""

    def __init__(self, *arguments: Any, each: int, late_ms: float) -> None:
        super().__init__(*arguments)
        self._each, self._late_ms, self._offered = each, late_ms, 0

    def offer(self, *arguments: Any, **more: Any) -> PacketRecord:
        record = super().offer(*arguments, **more)
        self._offered += record.kind is PacketKind.MEDIA
        is_late = record.kind is PacketKind.MEDIA and self._offered % self._each == 0
        if not is_late or not record.delivered_ns:
            return record
        return replace(record, delivered_ns=record.delivered_ns + round(self._late_ms * NS_PER_MS))


class CutLink(Link):
    """A link that loses everything between two times [s since the start]."""

    def __init__(self, *arguments: Any, cuts: tuple[tuple[float, float], ...]) -> None:
        super().__init__(*arguments)
        self._cuts = [tuple(START_NS + round(end * NS_PER_S) for end in cut) for cut in cuts]

    def offer(self, now_ns: int, *arguments: Any, **more: Any) -> PacketRecord:
        record = super().offer(now_ns, *arguments, **more)
        is_cut = any(begin <= now_ns < end for begin, end in self._cuts)
        return replace(record, delivered_ns=0, fate=type(record.fate).LOST) if is_cut else record


def record(
    network: Network,
    frames: int,
    rule: RepairRule,
    link: Callable[..., Link] = Link,
    fps: int = 30,
    **more: Any,
) -> PacketLog:
    """Run one view in virtual time over `link`; `more`: as for `make`."""
    log, run = PacketLog(rule), Run()
    with (
        patch("tams_app.video.virtual.video.Link", link),
        closing(make(run, network, (VIEW,), rule=rule, **more)) as video,
    ):
        _listen(log, video)
        for index in range(frames):
            video.advance_to(START_NS + index * NS_PER_S // fps)
            video.push(Frame(VIEW, index, video.now_ns, frame(index * 30 // fps).image))
        video.advance_to(video.now_ns + NS_PER_S)
        log.end_ms = video.now_ns / NS_PER_MS
    log.told = [feedback for _, feedback, _ in run.feedback]
    return log


def first_times(asked: Iterable[tuple[float, Iterable[int]]]) -> dict[int, float]:
    """When each number was named first; `asked`: times, in order, and numbers."""
    times: dict[int, float] = {}
    for ms, numbers in asked:
        for number in numbers:
            times.setdefault(number, ms)
    return times


class _HeardChain(WholeChain):
    """The chain, and its last verdict."""

    verdict = (0, False)

    def access_unit(self, timestamp: int, has_idr: bool, has_end: bool) -> bool:
        is_whole = super().access_unit(timestamp, has_idr, has_end)
        self.verdict = timestamp, is_whole
        return is_whole


def _listen(log: PacketLog, video: VirtualVideo) -> None:
    receiver = video.receivers[VIEW]
    decoder, arrive = receiver.decoder, receiver.arrive
    chain = decoder._receiver._chain = _HeardChain()

    def on_arrival(packet: bytes, resent: bool) -> None:
        kept = as_resent(packet, len(log.packets)) if resent else packet
        log.packets.append((video.now_ns / NS_PER_MS, kept))
        arrive(packet, resent)

    def on_unit(_pad: Any, probe: Any) -> Any:
        buffer = probe.get_buffer()
        data = annex_b(buffer.extract_dup(0, buffer.get_size()))
        log.units.append(Unit(video.now_ns / NS_PER_MS, *chain.verdict, data))
        return gst.load().Gst.PadProbeReturn.OK

    receiver.arrive = on_arrival  # type: ignore[method-assign]
    pad = decoder._depayloader.get_static_pad("src")
    pad.add_probe(gst.load().Gst.PadProbeType.BUFFER, on_unit)  # behind the product's own


def as_resent(packet: bytes, number: int) -> bytes:
    """The packet as RTX (RFC 4588) carries it, in a stream of its own."""
    header = read_rtp(packet)
    assert header is not None
    start, ssrc = header.payload_offset, repair_ssrc(VideoConfig(views=(VIEW,)), VIEW)
    kind = packet[1] & 0x80 | REPAIR_PAYLOAD_TYPE
    fixed = packet[:1] + bytes([kind]) + number.to_bytes(2) + packet[4:8] + ssrc.to_bytes(4)
    return fixed + packet[12:start] + packet[2:4] + packet[start:]


def annex_b(units: bytes) -> bytes:
    """NAL units behind start codes in place of their lengths."""
    parts, at = [], 0
    while at < len(units):
        end = at + LENGTH_BYTES + int.from_bytes(units[at : at + LENGTH_BYTES])
        parts.append(START_CODE + units[at + LENGTH_BYTES : end])
        at = end
    return b"".join(parts)


def pictures(data: bytes) -> bytes:
    """Without the parameter sets, which GStreamer's depayloader hands on beside the frames."""
    units = data.split(START_CODE)[1:]
    return b"".join(START_CODE + unit for unit in units if unit[0] & 0x1F not in PARAMETER_SETS)


def page_rule(rule: RepairRule) -> dict[str, Any]:
    """The rule in the page's words; without a longest wait where there is none, as JSON has it."""
    return {
        re.sub("_(.)", lambda match: match[1].upper(), key): value
        for key, value in asdict(rule).items()
        if value != math.inf
    }
