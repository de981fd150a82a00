"""The page's receive path, in JavaScript, against the product's own, packet by packet.

Both get the same packets at the same times. Where the page's simpler rule of waiting differs from
GStreamer's jitter buffer, which decides in the product, is said by the tests:

- it hands out a stream's first packet at once, where the jitter buffer keeps it for its latency,
  and the first keyframe counts though the stream began before, where the product's chain begins
  with the second;
- its wait for a missing packet counts from when the packet is missed, the jitter buffer's from
  when it was expected by the first packet's delay: where a queue has grown since, that is earlier;
- it waits for no packet that the sender no longer keeps, and asks for a keyframe at once.
"""

from __future__ import annotations

import json
import subprocess
from base64 import b64decode, b64encode
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from random import Random
from typing import Any

import pytest

from tams_app.config import Network, RepairConfig, VideoConfig
from tams_app.records import PacketKind
from tams_app.units import NS_PER_MS
from tams_app.video.core.packets import (
    identify,
    media_ssrc,
    read_rtp,
    receiver_ssrc,
    rtp_header,
    with_transport_sequence,
)
from tams_app.video.core.repair import repair_rule
from tams_app.video.core.rtcp import ARRIVAL_TICK_NS, read_arrivals, read_blocks
from tams_app.video.virtual.rtcp_sessions import StreamStatistics
from tests.page.packet_logs import (
    PARAMETER_SETS,
    START_CODE,
    VIEW,
    CutLink,
    PacketLog,
    ReorderingLink,
    Unit,
    first_times,
    page_rule,
    pictures,
    record,
)

pytestmark = pytest.mark.untimed

HERE = Path(__file__).parent
UNITS = sorted(HERE.glob("*.test.js"))
FRAMES = 150
STEP_MS = 30  # between two regular reports of the product's receiver, at most
RECEIVER_REPORT, NACK, ARRIVALS, PLI = (201, 1), (205, 1), (205, 15), (206, 1)

NEAR = Network(latency_ms=20, jitter_ms=4)
NETWORKS: dict[str, tuple[Network, dict[str, Any]]] = {
    "resends": (NEAR.model_copy(update={"loss": 0.04}), {}),
    "bursts": (
        Network(latency_ms=40, jitter_ms=8, loss=0.05, loss_burst=4, rate_kbps=6000),
        {"feedback": True},
    ),
    "no repair": (Network(latency_ms=90, jitter_ms=4, loss=0.02), {}),
    "parity": (
        Network(latency_ms=80, jitter_ms=5, loss=0.04, rate_kbps=3000),
        {"mode": "adaptive", "groups": 2, "feedback": True, "kbps": 2400.0},
    ),
    "parity and bursts": (
        Network(latency_ms=80, jitter_ms=5, loss=0.08, loss_burst=3, rate_kbps=3000),
        {"mode": "adaptive", "groups": 1, "feedback": True},
    ),
    "reordered": (
        NEAR.model_copy(update={"loss": 0.01}),
        {"link": partial(ReorderingLink, each=7, late_ms=9), "feedback": True},
    ),
    "reordered, no repair": (
        Network(latency_ms=90, jitter_ms=4),
        {"link": partial(ReorderingLink, each=90, late_ms=35)},
    ),
    "cuts": (
        NEAR,
        {"link": partial(CutLink, cuts=((1.0, 1.1), (2.0, 2.8), (3.5, 3.6))), "feedback": True},
    ),
    "joined late": (NEAR, {"link": partial(CutLink, cuts=((0.0, 0.5),))}),
    "few frames": (NEAR.model_copy(update={"loss": 0.04}), {"mode": "adaptive", "fps": 10}),
    "a queue that grows": (
        Network(latency_ms=20, jitter_ms=8, loss=0.05, rate_kbps=850, queue_ms=600),
        {},
    ),
    "a long cut": (NEAR, {"link": partial(CutLink, cuts=((1.0, 2.5),))}),
}
# more frames are whole there: the jitter buffer gives packets up that come in time for the page
EARLIER = {"a queue that grows", "joined late"}
CUT_OFF = {"a long cut"}
FED_BACK = [name for name, (_, more) in NETWORKS.items() if more.get("feedback")]


@dataclass(frozen=True)
class Received:
    """What the page's receiver made of a log."""

    units: list[Unit]
    rtcp: list[tuple[float, int, bytes]]  # when each left [ms], and how many packets had come

    @property
    def whole(self) -> dict[int, Unit]:
        return {unit.timestamp: unit for unit in self.units if unit.is_whole}

    def packets(self, kind: tuple[int, int]) -> list[tuple[float, int, bytes]]:
        """Packets of RTCP of one type and format, as `rtcp`."""
        return [(ms, came, one) for ms, came, all_ in self.rtcp for one in split(all_, kind)]

    @property
    def arrivals(self) -> dict[int, int]:
        """When each packet of the session came [ns], by its number there."""
        messages = [read_arrivals(message[12:]) for *_, message in self.packets(ARRIVALS)]
        arrivals = {number: ns for message in messages for number, ns in message.items()}
        assert len(arrivals) == sum(map(len, messages)), "none twice"
        return arrivals

    @property
    def nacks(self) -> dict[int, float]:
        return first_times((ms, nacked(one)) for ms, _, one in self.packets(NACK))

    @property
    def plis_ms(self) -> list[float]:
        return [ms for ms, *_ in self.packets(PLI)]


def split(datagram: bytes, kind: tuple[int, int]) -> list[bytes]:
    found, at = [], 0
    while at < len(datagram):
        end = at + 4 + 4 * int.from_bytes(datagram[at + 2 : at + 4])
        if (datagram[at + 1], datagram[at] & 0x1F) == kind:
            found.append(datagram[at:end])
        at = end
    assert at == len(datagram)
    return found


def nacked(packet: bytes) -> list[int]:
    """The numbers that a NACK (RFC 4585, 6.2.1) names."""
    numbers = []
    for at in range(12, len(packet), 4):
        first, others = int.from_bytes(packet[at : at + 2]), int.from_bytes(packet[at + 2 : at + 4])
        numbers += [first, *((first + bit + 1) % 65536 for bit in range(16) if others >> bit & 1)]
    return numbers


@cache
def golden(name: str) -> PacketLog:
    network, more = NETWORKS[name]
    repair = RepairConfig(mode=more.get("mode", "paper"))
    rule = repair_rule(network, VideoConfig().pli_min_interval_ms, repair)
    others = {key: value for key, value in more.items() if key != "mode"}
    return record(network, FRAMES, rule, **others)


@pytest.fixture(scope="session")
def replays(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The page's receiver over a golden log, each once."""
    folder = tmp_path_factory.mktemp("logs")

    @cache
    def received(name: str) -> Received:
        return replay(golden(name), name in FED_BACK, folder / f"{name}.json")

    return received


def replay(log: PacketLog, feedback: bool, path: Path) -> Received:
    packets = [(ms, b64encode(packet).decode()) for ms, packet in log.packets]
    content = {"rule": page_rule(log.rule), "feedback": feedback, "packets": packets}
    path.write_text(json.dumps(content | {"endMs": log.end_ms}))
    printed = json.loads(node("replay.js", str(path)))
    units = [
        Unit(one["receivedMs"], one["timestamp"], one["isWhole"], b64decode(one["data"]))
        for one in printed["units"]
    ]
    rtcp = [(ms, came, b64decode(datagram)) for ms, came, datagram in printed["rtcp"]]
    return Received(units, rtcp)


def node(*arguments: str) -> str:
    return subprocess.run(
        ["node", *arguments], cwd=HERE, check=True, capture_output=True, text=True
    ).stdout


@pytest.mark.parametrize("units", UNITS, ids=lambda units: units.name)
def test_each_module_keeps_its_promises(units: Path) -> None:
    ran = subprocess.run(["node", "--test", units], cwd=HERE, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout


@pytest.mark.parametrize("name", NETWORKS)
def test_the_same_frames_are_whole_and_their_bytes_the_same(name: str, replays: Any) -> None:
    mine, theirs = replays(name).whole, golden(name).whole
    assert len(theirs) > 0.3 * FRAMES
    assert mine.keys() >= theirs.keys()
    assert mine.keys() == theirs.keys() or name in EARLIER
    for timestamp, unit in theirs.items():
        assert pictures(mine[timestamp].data) == unit.data


@pytest.mark.parametrize("name", NETWORKS)
def test_whole_frames_are_handed_out_at_the_same_time_the_first_ones_earlier(
    name: str, replays: Any
) -> None:
    log, mine = golden(name), replays(name).whole
    beginning_ms = log.packets[0][0] + log.rule.latency_ms
    for timestamp, unit in log.whole.items():
        earlier_ms = unit.received_ms - mine[timestamp].received_ms
        assert earlier_ms == pytest.approx(0, abs=1e-3) or (
            0 < earlier_ms <= log.rule.latency_ms and unit.received_ms <= beginning_ms + 1
        )


@pytest.mark.parametrize("name", NETWORKS)
def test_a_decoder_can_begin_at_each_keyframe(name: str, replays: Any) -> None:
    first, *_ = replays(name).whole.values()
    kinds = [unit[0] & 0x1F for unit in first.data.split(START_CODE)[1:]]
    assert set(kinds[:2]) == PARAMETER_SETS


@pytest.mark.parametrize("name", NETWORKS)
def test_the_same_packets_are_asked_for_at_once(name: str, replays: Any) -> None:
    mine, theirs = replays(name).nacks, golden(name).nacks
    if name in CUT_OFF:
        assert not mine
        return
    assert mine.keys() == theirs.keys()
    assert bool(theirs) == golden(name).rule.rtx or name == "joined late"
    for number, asked_ms in theirs.items():
        assert -1e-3 <= asked_ms - mine[number] <= STEP_MS


@pytest.mark.parametrize("name", NETWORKS)
def test_keyframes_are_asked_for_at_the_same_times(name: str, replays: Any) -> None:
    mine, theirs = replays(name).plis_ms, golden(name).plis_ms
    if name in EARLIER:
        assert 0 < len(mine) <= len(theirs)
        return
    assert len(mine) == len(theirs)
    most_ms = STEP_MS + (golden(name).rule.latency_ms if name in CUT_OFF else 0)
    for my_ms, their_ms in zip(mine, theirs, strict=True):
        assert -STEP_MS <= their_ms - my_ms <= most_ms


@pytest.mark.parametrize("name", FED_BACK)
def test_each_packet_is_reported_with_the_time_it_came(name: str, replays: Any) -> None:
    log, mine = golden(name), replays(name).arrivals
    late = {number for number in log.arrivals.keys() - mine.keys() if name == "reordered"}
    assert len(late) < 0.1 * len(mine)
    assert mine.keys() | late == log.arrivals.keys()
    for number, arrived_ns in mine.items():
        assert arrived_ns == log.arrivals[number]
        assert arrived_ns % ARRIVAL_TICK_NS == 0


def test_arrivals_are_told_exactly_through_pauses_gaps_and_a_wrap(tmp_path: Path) -> None:
    random, ms, number = Random(1), 0.0, 65_000
    log = PacketLog(golden("cuts").rule)
    sent: dict[int, float] = {}
    for place in range(600):
        ms += random.choice([0.0, 0.1, 3.0, 63.75, 64.0, 70.0, 400.0, 8000.0])
        number = (number + random.choice([1, 1, 1, 2, 5, 9, 40])) % 65536
        ends, ssrc = random.random() < 0.1, media_ssrc(VideoConfig(views=(VIEW,)), VIEW)
        header = rtp_header(96, place, 90 * round(ms), ssrc, marker=ends, numbered=True)
        log.packets.append((ms, with_transport_sequence(header, number) + b"A"))
        sent[number] = ms
    log.end_ms = ms
    told = replay(log, True, tmp_path / "log.json").arrivals
    assert len(told) > 500
    assert min(told) < 5000 < 65_000 <= max(told)
    for number, ns in told.items():
        assert ns == int(sent[number] * NS_PER_MS) // ARRIVAL_TICK_NS * ARRIVAL_TICK_NS


@pytest.mark.parametrize("name", NETWORKS)
def test_report_blocks_say_what_came_of_the_media(name: str, replays: Any) -> None:
    config, log = VideoConfig(views=(VIEW,)), golden(name)
    statistics, first, taken = StreamStatistics(), identify(log.packets[0][1])[1], 0
    reports, before = replays(name).packets(RECEIVER_REPORT), (0, first - 1)
    assert len(reports) > 5
    for _, came, report in reports:
        for ms, packet in log.packets[taken:came]:
            header = read_rtp(packet)
            assert header is not None
            if header.kind is PacketKind.MEDIA:
                statistics.received(round(ms * NS_PER_MS), header)
        taken, expected = came, statistics.block(media_ssrc(config, VIEW))
        (block,) = read_blocks(report, 0)
        assert int.from_bytes(report[4:8]) == receiver_ssrc(config, VIEW)
        assert (block.ssrc, block.highest_sequence) == (expected.ssrc, expected.highest_sequence)
        assert block.lost == expected.lost - first, "of what came before nothing is known"
        assert abs(block.jitter - expected.jitter) <= 1
        lost_now, sent_now = block.lost - before[0], block.highest_sequence - before[1]
        assert report[12] == (256 * max(0, lost_now) // sent_now if sent_now else 0)
        before = block.lost, block.highest_sequence
