"""A session's records made from arithmetic: known numbers in, so that tests know what comes out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tams_app.recording import FrameCaptured, FrameSent, FrameShown, Header, SessionLog
from tams_app.recording.journal import DirectRecorder
from tams_app.recording.mcap_log import McapLog
from tams_app.records import (
    IP_UDP_HEADER_BYTES,
    Activity,
    Allocation,
    ArmState,
    CommandLink,
    ControllerSample,
    ControllerStatus,
    LinkCapacity,
    Outcome,
    PacketFate,
    PacketKind,
    PacketRecord,
    Phase,
    PhaseChange,
    Pose,
    ServoMode,
    StopRecord,
    SystemSample,
    Tick,
    Twist,
)
from tams_app.rotation import Rotation
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_MS, NS_PER_S

START_NS = 5 * NS_PER_S
VIEWS = ("eih", "gt", "gs")
FPS = 30
PERIOD_NS = NS_PER_S // 120
TARGETS = {
    Phase.REACH: {"eih": 1000, "gt": 2000, "gs": 2000},
    Phase.ALIGN: {"eih": 3000, "gt": 1000, "gs": 1000},
}
WEIGHTS = {phase: {"eih": 0.2, "gt": 0.4, "gs": 0.4} for phase in Phase} | {
    Phase.ALIGN: {"eih": 0.6, "gt": 0.2, "gs": 0.2}
}


def never_fails(thread: str, failure: BaseException) -> None:
    """For recorders that must not fail."""
    raise AssertionError(f"{thread} failed") from failure


def write_log(path: Path, records: Iterable[Any], head: Header | None = None) -> Path:
    """A log with these records, written as in virtual time."""
    with closing(DirectRecorder(McapLog(path, head or header()), VirtualClock(START_NS))) as log:
        for record in records:
            log.record(record)
    return path


def header(**changes: Any) -> Header:
    base = Header(
        version="0.1.0",
        name="run",
        seed=7,
        strategy="tams",
        network="s2",
        budget_mode="oracle",
        servo="velocity",
        control_rate_hz=120.0,
        views=VIEWS,
        fps=FPS,
        weights=WEIGHTS,
        started_ns=START_NS,
        wall_offset_ns=1_800_000_000 * NS_PER_S,
        config={"version": 1, "video": {"views": list(VIEWS)}},
    )
    return replace(base, **changes)


def tick(number: int, late_ns: int = 0, cost_ns: int = 400_000, skipped: int = 0) -> Tick:
    due_ns = START_NS + (number + skipped) * PERIOD_NS
    pose = Pose(
        np.array([0.35, 0.01 * np.sin(number / 30), 0.18]), Rotation.from_quat([1, 0, 0, 0])
    )
    twist = Twist(np.array([0.1, 0.0123456789, 0.0]), np.zeros(3))
    hand = ControllerSample.released(ControllerStatus.OK, pose, due_ns, due_ns, 0.9)
    arm = ArmState(
        due_ns - NS_PER_MS,
        np.linspace(0, 1, 6) * 0.7,
        pose,
        Activity.MOVING,
        ServoMode.VELOCITY,
        None,
        gripper_closed=None,
    )
    link = CommandLink(number, due_ns - 7_000_000, 300_000 + number, 0, "")
    return Tick(
        due_ns=due_ns,
        started_ns=due_ns + late_ns,
        finished_ns=due_ns + late_ns + cost_ns,
        skipped=skipped,
        arming="ENGAGED",
        reason="",
        deadman=True,
        orientation_mode=False,
        phase=Phase.REACH,
        speed=0.1234567,
        vertical_speed=-0.01,
        speed_scale=1.0,
        twist=twist,
        controller=hand,
        arm=arm,
        link=link,
    )


def capture_ns(index: int) -> int:
    return START_NS + index * NS_PER_S // FPS


def rtp_timestamp(index: int) -> int:
    """Of a frame whose view began with index 0."""
    return index * 90_000 // FPS


def frame_packets(view: str, index: int, size_bytes: int, delay_ns: int) -> list[PacketRecord]:
    """`size_bytes` (IP) of one frame in packets of at most 1228 bytes, all delivered."""
    sizes = [1228] * (size_bytes // 1228)
    if size_bytes % 1228:
        sizes.append(max(size_bytes % 1228, IP_UDP_HEADER_BYTES + 13))
    entered_ns = capture_ns(index) + 5 * NS_PER_MS
    return [
        PacketRecord(
            view,
            PacketKind.MEDIA,
            (index * 20 + number) % 65536,
            size,
            entered_ns + number * 10_000,
            entered_ns + number * 10_000 + 8 * NS_PER_MS,
            entered_ns + number * 10_000 + delay_ns,
            PacketFate.DELIVERED,
            rtp_timestamp=rtp_timestamp(index),
        )
        for number, size in enumerate(sizes)
    ]


@dataclass
class Synthetic:
    """`seconds` of all views; the wire rate is `accuracy` × the target."""

    seconds: float
    accuracy: float = 1.0
    switch_s: float | None = None  # from REACH to ALIGN
    latency_ns: int = 60 * NS_PER_MS

    def phase_at(self, t_ns: int) -> Phase:
        switched = self.switch_s is not None and t_ns >= START_NS + self.switch_s * NS_PER_S
        return Phase.ALIGN if switched else Phase.REACH

    def log(self) -> SessionLog:
        end_ns = START_NS + round(self.seconds * NS_PER_S)
        log = SessionLog(header(), end_ns)
        log.ticks = [tick(number) for number in range(round(self.seconds * 120))]
        log.phases = [PhaseChange(START_NS, Phase.REACH, "start")]
        if self.switch_s is not None:
            switch_ns = START_NS + round(self.switch_s * NS_PER_S)
            log.phases.append(PhaseChange(switch_ns, Phase.ALIGN, "descending"))
        log.allocations = list(self._allocations())
        log.capacities = [LinkCapacity(START_NS, 6000.0)]
        for index in range(round(self.seconds * FPS)):
            for view in VIEWS:
                self._frame(log, view, index)
        log.system = [SystemSample(START_NS, 80.0, {"render": 30.0, "link": 4.0}, 300.0)]
        log.stops = [
            StopRecord("stale video", START_NS + NS_PER_S, START_NS + NS_PER_S + 55_000_000)
        ]
        log.outcome = Outcome(True, True, 42.5, 1, "placed")
        return log

    def _allocations(self) -> Iterator[Allocation]:
        for number in range(round(self.seconds * 20)):
            t_ns = START_NS + number * NS_PER_S // 20
            phase = self.phase_at(t_ns)
            yield Allocation(t_ns, phase, 6000.0, 5520.0, TARGETS[phase])

    def _frame(self, log: SessionLog, view: str, index: int) -> None:
        t_ns = capture_ns(index)
        log.captured.append(FrameCaptured(view, index, t_ns))
        ideal = TARGETS[self.phase_at(t_ns)][view] * 1000 / 8 / FPS
        size = round(ideal * self.accuracy)
        encoded_ns, is_first = t_ns + 4 * NS_PER_MS, index == 0
        log.sent.append(
            FrameSent(
                view, index, t_ns, encoded_ns, is_first, size, rtp_timestamp=rtp_timestamp(index)
            )
        )
        log.packets += frame_packets(view, index, size, delay_ns=50 * NS_PER_MS)
        log.shown.append(FrameShown(view, index, t_ns + self.latency_ns))


def live_records(seconds: float, video_bytes: int = 8000) -> Iterator[Any]:
    """What a running session hands to the recorder, in order of time."""
    log = Synthetic(seconds).log()
    random = np.random.default_rng(0)  # coded video does not compress any further
    frames = [sent.with_data(random.bytes(video_bytes)) for sent in log.sent]
    timed: list[tuple[int, Any]] = [
        *((record.started_ns, record) for record in log.ticks),
        *((record.t_ns, record) for record in (*log.phases, *log.allocations, *log.system)),
        *((record.t_ns, record) for record in log.capacities),
        *((record.encoded_ns, record) for record in frames),
        *((record.entered_ns, record) for record in log.packets),
        *((record.capture_ns, record) for record in log.captured),
        *((record.shown_ns, record) for record in log.shown),
    ]
    timed.sort(key=lambda entry: entry[0])
    return (record for _, record in timed)


def overshoot(log: SessionLog, from_s: float, until_s: float, factor: int) -> None:
    """Make the frames captured in [from_s, until_s) `factor` times as large."""
    low, high = round(from_s * 30), round(until_s * 30)
    extra = [one for one in log.packets if low * 3000 <= one.rtp_timestamp < high * 3000]
    log.packets += extra * (factor - 1)
