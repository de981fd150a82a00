"""The guard: its decisions in virtual time, its link, and the process against a controller."""

from __future__ import annotations

import json
import math
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, TypeAlias

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.arm_report import ArmReport
from hw.arms import ARM_KINDS
from hw.guard import process
from hw.guard.link import (
    ANSWERS,
    GuardLink,
    GuardMemory,
    GuardMessage,
    Heartbeat,
    decode_heartbeat,
    guard_specification,
    motion_limits,
)
from hw.guard.motion import Cause, Motion, MotionWatch
from hw.guard.process import Guard, GuardWatch, HeartbeatWatch
from hw.lite6.protocol import Mode
from hw.lite6.report_watch import REAL_PORT_OFFSET
from tams_app.config import ArmConfig, LimitsConfig
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.realtime import GUARD_PRIORITY
from tams_app.runtime.shared_ring import new_block_name
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.hw.lite6.controller_rig import ControllerRig, controller, until

pytestmark = pytest.mark.waiting

TIMEOUT_NS = 100 * NS_PER_MS
LIMITS = LimitsConfig()


def beat(arming: int, sequence: int) -> Heartbeat:
    return Heartbeat(GuardMessage.BEAT, arming, sequence)


def disarm(arming: int, sequence: int) -> Heartbeat:
    return Heartbeat(GuardMessage.DISARM, arming, sequence)


def query(arming: int, sequence: int) -> Heartbeat:
    return Heartbeat(GuardMessage.QUERY, arming, sequence)


# --- the decision -------------------------------------------------------------------------------


def test_silence_before_the_first_beat_stops_nothing() -> None:
    watch = HeartbeatWatch(TIMEOUT_NS)
    assert not watch.lost(10 * NS_PER_S)
    assert watch.watch is GuardWatch.IDLE
    assert (watch.arming, watch.sequence) == (0, 0)


@given(st.lists(st.integers(0, TIMEOUT_NS), min_size=1, max_size=50))
def test_beats_within_the_timeout_never_stop_the_arm(gaps_ns: list[int]) -> None:
    watch = HeartbeatWatch(TIMEOUT_NS)
    now_ns = 0
    for sequence, gap_ns in enumerate(gaps_ns, start=1):
        now_ns += gap_ns
        assert not watch.lost(now_ns)
        watch.hear(now_ns, beat(1, sequence))
        assert watch.watch is GuardWatch.ARMED


def test_a_lost_heartbeat_stops_the_arm_once_and_latches() -> None:
    watch = HeartbeatWatch(TIMEOUT_NS)
    watch.hear(0, beat(1, 1))
    assert not watch.lost(TIMEOUT_NS)
    assert watch.lost(TIMEOUT_NS + 1)
    assert not watch.lost(TIMEOUT_NS + 2)
    watch.hear(TIMEOUT_NS + 3, beat(1, 2))
    assert watch.watch is GuardWatch.LATCHED


def test_a_new_arming_ends_the_latch() -> None:
    watch = HeartbeatWatch(TIMEOUT_NS)
    watch.hear(0, beat(1, 1))
    assert watch.lost(2 * TIMEOUT_NS)
    watch.hear(3 * TIMEOUT_NS, beat(2, 2))
    assert watch.watch is GuardWatch.ARMED
    assert watch.lost(5 * TIMEOUT_NS)


@pytest.mark.parametrize(
    ("heard", "watch"),
    [
        ([beat(1, 1), disarm(1, 3), beat(1, 2)], GuardWatch.IDLE),
        ([beat(1, 1), beat(2, 3), disarm(1, 4)], GuardWatch.ARMED),
        ([query(0, 3), query(1, 4)], GuardWatch.IDLE),  # the arming itself was not heard
        ([beat(1, 1), disarm(1, 2), query(1, 3), query(2, 4)], GuardWatch.IDLE),
    ],
    ids=["a late beat", "a late disarm of an older arming", "asked", "asked after an arming"],
)
def test_nothing_that_comes_late_or_only_asks_arms_or_disarms(
    heard: list[Heartbeat], watch: GuardWatch
) -> None:
    watched = HeartbeatWatch(TIMEOUT_NS)
    for now_ns, heartbeat in enumerate(heard):
        watched.hear(now_ns, heartbeat)
    assert watched.watch is watch
    assert watched.lost(NS_PER_S) == (watch is GuardWatch.ARMED)


def test_a_repeated_or_reordered_beat_does_not_count_as_life() -> None:
    watch = HeartbeatWatch(TIMEOUT_NS)
    watch.hear(0, beat(1, 5))
    watch.hear(TIMEOUT_NS, beat(1, 5))
    watch.hear(TIMEOUT_NS, beat(1, 4))
    assert watch.lost(TIMEOUT_NS + 1)


@given(st.binary(max_size=40))
def test_foreign_records_are_no_heartbeats(data: bytes) -> None:
    assert decode_heartbeat(data) is None


@pytest.mark.parametrize(
    ("at", "odd"),
    [
        (0, b"TAMH"),
        (4, bytes([5])),
        (18, bytes([3])),
        (19, struct.pack("!f", float("nan"))),
        (19, struct.pack("!f", -0.1)),
        (23, bytes([6])),
    ],
    ids=["magic", "message", "motion", "no speed", "speed backwards", "cause"],
)
def test_a_record_of_which_one_field_is_unknown_is_no_heartbeat(at: int, odd: bytes) -> None:
    record = bytearray(Heartbeat(GuardMessage.BEAT, 1, 1, speed=0.25).encode())
    assert decode_heartbeat(bytes(record)) is not None
    record[at : at + len(odd)] = odd
    assert decode_heartbeat(bytes(record)) is None


@given(
    st.sampled_from(GuardMessage),
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**64 - 1),
    st.booleans(),
    st.booleans(),
    st.sampled_from(Cause),
    st.sampled_from(Motion),
    st.booleans(),
    st.floats(0.0, width=32),
)
def test_heartbeats_survive_the_memory(
    message: GuardMessage,
    arming: int,
    sequence: int,
    latched: bool,
    arm_lost: bool,
    cause: Cause,
    motion: Motion,
    deadman: bool,
    speed: float,
) -> None:
    heartbeat = Heartbeat(
        message, arming, sequence, latched, arm_lost, cause, motion, deadman, speed
    )
    assert decode_heartbeat(heartbeat.encode()) == heartbeat


# --- the link -----------------------------------------------------------------------------------


class SilentGuard:
    """The guard's side of the memory; it hears and says what a test wants."""

    def __init__(self) -> None:
        self.name = new_block_name()
        self.memory = GuardMemory(self.name)
        self.runs = True
        self._heard = 0

    def hear(self) -> Heartbeat | None:
        record = self.memory.beats.head(self._heard)
        assert record is not None, "nothing was said"
        self._heard += 1
        return decode_heartbeat(record)

    def answer(self, answer: Heartbeat) -> None:
        self.memory.answers.put(answer.encode())


class NotedStop:
    """The channel of a guard; counts the stops."""

    failure = ""
    pending = False

    def __init__(self) -> None:
        self.stops = 0

    def start(self) -> None:
        """Nothing to connect."""

    def request_stop(self) -> None:
        self.stops += 1

    def wait_acknowledged(self, timeout_s: float) -> bool:
        return True

    def close(self) -> None:
        """Nothing to close."""


class ToldReports:
    """Hands out each report that a test tells it, once."""

    told: ArmReport | None = None

    def start(self) -> None:
        """Nothing to connect."""

    def newest(self, now_ns: int) -> ArmReport | None:
        report, self.told = self.told, None
        return report

    def close(self) -> None:
        """Nothing to close."""


@pytest.fixture
def silent_guard() -> Iterator[SilentGuard]:
    made = SilentGuard()
    yield made
    made.memory.hide()
    made.memory.close()


@pytest.fixture
def link(silent_guard: SilentGuard) -> Iterator[GuardLink]:
    made = GuardLink(GuardMemory(silent_guard.name), TIMEOUT_NS, lambda: silent_guard.runs)
    yield made
    made.close()


def test_a_link_that_is_not_armed_hears_whether_the_guard_has_the_arm_but_of_no_stop(
    silent_guard: SilentGuard, link: GuardLink
) -> None:
    link.beat(0)
    silent_guard.answer(Heartbeat(GuardMessage.ACKNOWLEDGEMENT, 0, 1, latched=True, arm_lost=True))
    assert until(lambda: link.beat(1) or link.arm_lost)
    assert not link.latched


@pytest.mark.parametrize("heard_ns", [0, 50], ids=["never", "once"])
def test_a_guard_is_gone_once_it_has_not_answered_for_as_long(
    silent_guard: SilentGuard, link: GuardLink, heard_ns: int
) -> None:
    link.arm()
    link.beat(0)
    if heard_ns:
        silent_guard.answer(Heartbeat(GuardMessage.ACKNOWLEDGEMENT, 1, 1))
        link.beat(heard_ns)
    assert link.alive(heard_ns + TIMEOUT_NS)
    gone_ns = heard_ns + TIMEOUT_NS + 1
    assert not link.alive(gone_ns)
    link.beat(gone_ns)
    assert not link.alive(gone_ns)


def test_a_stop_among_the_answers_that_wait_is_a_latch_until_the_next_arming(
    silent_guard: SilentGuard, link: GuardLink
) -> None:
    link.arm()
    link.beat(0)
    for latched in (False, True, False):  # the last one may have been under way when it latched
        silent_guard.answer(Heartbeat(GuardMessage.ACKNOWLEDGEMENT, 1, 1, latched))
    link.beat(TIMEOUT_NS)
    assert link.latched
    assert link.alive(2 * TIMEOUT_NS)
    link.arm()
    assert not link.latched


def test_a_guard_that_lost_the_arm_is_not_alive(silent_guard: SilentGuard, link: GuardLink) -> None:
    link.arm()
    link.beat(0)
    silent_guard.answer(Heartbeat(GuardMessage.ACKNOWLEDGEMENT, 1, 1, arm_lost=True))
    assert until(lambda: link.beat(1) or link.arm_lost)
    assert not link.alive(1)
    assert link.answers(1)


def test_an_arming_is_acknowledged_by_an_answer_to_one_of_its_own_beats(
    silent_guard: SilentGuard, link: GuardLink
) -> None:
    link.arm()
    link.beat(0)
    assert not link.acknowledged
    first, second = (Heartbeat(GuardMessage.ACKNOWLEDGEMENT, arming, 1) for arming in (1, 2))
    silent_guard.answer(first)
    assert until(lambda: link.beat(1) or link.acknowledged)
    link.disarm()
    assert not link.acknowledged
    link.arm()
    silent_guard.answer(first)  # late
    for _ in range(10):
        link.beat(2)
    assert not link.acknowledged
    silent_guard.answer(second)
    assert until(lambda: link.beat(3) or link.acknowledged)


def test_the_link_says_what_it_was_told_numbers_it_one_by_one_and_each_arming_too(
    silent_guard: SilentGuard, link: GuardLink
) -> None:
    link.beat(0)
    assert link.alive(NS_PER_S), "it only asks"
    link.arm()
    link.beat(0)
    link.beat(0, Motion.FOLLOW, True, 0.25)
    link.beat(0, Motion.HOME, False, 0.125)
    link.disarm()
    link.beat(0, Motion.FOLLOW, True, 0.25)
    link.arm()
    link.beat(0)
    assert [silent_guard.hear() for _ in range(7)] == [
        Heartbeat(GuardMessage.QUERY, 0, 1),
        Heartbeat(GuardMessage.BEAT, 1, 2),
        Heartbeat(GuardMessage.BEAT, 1, 3, motion=Motion.FOLLOW, deadman=True, speed=0.25),
        Heartbeat(GuardMessage.BEAT, 1, 4, motion=Motion.HOME, speed=0.125),
        Heartbeat(GuardMessage.DISARM, 1, 5),
        Heartbeat(GuardMessage.QUERY, 1, 6),
        Heartbeat(GuardMessage.BEAT, 2, 7),
    ]


@pytest.mark.parametrize("answers", [1, 1000])
def test_a_beat_looks_at_new_answers_that_are_kept_and_at_no_others(
    silent_guard: SilentGuard, monkeypatch: pytest.MonkeyPatch, answers: int
) -> None:
    """It is to take as long after an hour as at first."""
    memory = GuardMemory(silent_guard.name)
    link = GuardLink(memory, TIMEOUT_NS, lambda: True)
    head, looked_at = memory.answers.head, []

    def noted(number: int) -> bytes | None:
        looked_at.append(number)
        return head(number)

    monkeypatch.setattr(memory.answers, "head", noted)
    for _ in range(answers):
        silent_guard.answer(Heartbeat(GuardMessage.ACKNOWLEDGEMENT, 0, 1))
    link.beat(0)
    assert looked_at == list(range(max(0, answers - ANSWERS.heads), answers))
    looked_at.clear()
    silent_guard.answer(Heartbeat(GuardMessage.ACKNOWLEDGEMENT, 0, 1, arm_lost=True))
    link.beat(1)
    link.beat(2)
    assert looked_at == [answers]
    assert link.arm_lost
    link.close()


# --- what the guard is told of the arm ----------------------------------------------------------


def test_the_guards_limits_are_the_configurations_in_metres_radians_and_nanoseconds() -> None:
    arm = ArmConfig(velocity_deadman_s=0.15, ready_speed_deg_s=18.0, boundary_margin_mm=35.0)
    limits = LimitsConfig(
        max_speed_mm_s=200.0,
        leash_mm=12.0,
        box_min_mm=(160.0, -310.0, 7.0),
        box_max_mm=(410.0, 320.0, 390.0),
        radius_min_mm=190.0,
        radius_max_mm=430.0,
        floor_mm=6.0,
    )
    told = motion_limits(arm, limits)
    assert told.grace_ns == 350 * NS_PER_MS  # 200 ms to brake, and the deadman time
    assert told.low == pytest.approx((0.16, -0.31, 0.007))
    assert told.high == pytest.approx((0.41, 0.32, 0.39))
    rest = (told.speed_m_s, told.leash_m, told.radius_min, told.radius_max, told.floor)
    assert rest == pytest.approx((0.2, 0.012, 0.19, 0.43, 0.006))
    assert told.home_rad_s == pytest.approx(0.1 * math.pi)
    assert told.margin_m == pytest.approx(0.035)


def test_the_guards_specification_holds_all_that_it_needs_and_can_be_written_as_json() -> None:
    told = {"host": "192.0.2.7", "control_port": 503, "report_port": 30002, "reply_timeout_s": 0.05}
    config = ArmConfig.model_validate(told | {"guard": {"heartbeat_timeout_ms": 80.0}})
    specification = guard_specification(config, LIMITS)
    assert json.loads(json.dumps(specification)) == told | {
        "stop_channel": "hw.lite6.stop_channel:Lite6StopChannel",
        "report_watch": "hw.lite6.report_watch:Lite6ReportWatch",
        "heartbeat_timeout_ms": 80.0,
        "motion": motion_limits(config, LIMITS)._asdict(),
    }


# --- the process --------------------------------------------------------------------------------


class GuardedArm:
    """A moving arm, a guard process and a control loop that beats until told otherwise."""

    def __init__(self, rig: ControllerRig) -> None:
        self.rig = rig
        config = rig.config()
        self.process = HelperProcess(
            "guard",
            "hw.guard.process",
            guard_specification(config, LIMITS)
            | {"heartbeat_timeout_ms": 1000.0},  # a busy machine
            None,
        )
        self.process.start()
        memory = GuardMemory(self.process.wait_ready()["memory"])
        self.link = GuardLink(memory, NS_PER_S, lambda: self.process.exit_code is None)

    def beat_for(self, seconds: float) -> None:
        """Beat for that long, or until the guard has stopped the arm."""
        deadline_ns = self.now_ns + round(seconds * NS_PER_S)
        while self.now_ns < deadline_ns and not self.link.latched:
            self.link.beat(self.now_ns)
            time.sleep(0.005)

    @property
    def now_ns(self) -> int:
        return time.monotonic_ns()

    def close(self) -> None:
        self.link.close()
        self.process.stop()


@pytest.fixture
def rig() -> Iterator[ControllerRig]:
    with controller() as made:
        made.make_ready(Mode.CARTESIAN_VELOCITY)
        yield made


@pytest.fixture
def guarded(rig: ControllerRig) -> Iterator[GuardedArm]:
    with closing(GuardedArm(rig)) as arm:
        yield arm


def test_while_the_heart_beats_the_arm_is_left_alone_and_then_stopped_until_armed_anew(
    guarded: GuardedArm,
) -> None:
    guarded.link.arm()
    guarded.beat_for(1.5)
    assert not guarded.rig.stopped
    assert until(lambda: guarded.rig.stopped)
    assert until(lambda: guarded.link.beat(guarded.now_ns) or guarded.link.latched)
    guarded.rig.make_ready(Mode.CARTESIAN_VELOCITY)
    guarded.link.arm()
    guarded.beat_for(0.5)
    assert not guarded.rig.stopped
    assert not guarded.link.latched


def test_the_guard_starts_without_the_heavy_libraries() -> None:
    heavy = "('numpy', 'scipy', 'xarm', 'pydantic', 'tams_app.teleop')"
    guard = "hw.guard.process, hw.lite6.stop_channel, hw.lite6.report_watch"
    code = f"import sys, {guard}; print([m for m in {heavy} if m in sys.modules])"
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert out.stdout.strip() == "[]"


# --- what the arm does while the heart beats ----------------------------------------------------


def test_a_guard_without_reports_is_blind_until_it_has_them_again(guarded: GuardedArm) -> None:
    guarded.link.arm()
    guarded.beat_for(0.2)
    assert not guarded.link.arm_lost
    guarded.rig.model.reports_frozen = True
    assert until(lambda: guarded.beat_for(0.02) or guarded.link.arm_lost)
    guarded.rig.model.reports_frozen = False
    assert until(lambda: guarded.beat_for(0.02) or not guarded.link.arm_lost)
    guarded.rig.server.drop_connections()
    guarded.beat_for(0.2)
    assert until(lambda: guarded.beat_for(0.02) or not guarded.link.arm_lost)


def test_the_guard_watches_an_arm_of_another_kind_by_that_kinds_own_reports(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(ARM_KINDS, "toy", "tests.contract.toy_arm:KIND")
    with ExitStack() as opened:
        control, reports = (
            opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)
        )
        for each in (control, reports):
            each.bind(("127.0.0.1", 0))
            each.settimeout(10.0)
        ports = [each.getsockname()[1] for each in (control, reports)]
        config = ArmConfig(model="toy", control_port=ports[0], report_port=ports[1])
        specification = guard_specification(config, LIMITS) | {"heartbeat_timeout_ms": 1000.0}
        process = HelperProcess("guard", "hw.guard.process", specification, None)
        process.start()
        opened.callback(process.stop)
        memory = GuardMemory(process.wait_ready()["memory"])
        link = GuardLink(memory, NS_PER_S, lambda: process.exit_code is None)
        opened.callback(link.close)
        link.arm()
        began_s = time.monotonic()
        while not link.latched:
            link.beat(time.monotonic_ns())
            _, guard = reports.recvfrom(64)
            away_s = max(0.0, time.monotonic() - began_s - 0.5)  # it moves unasked after .5 s
            y, turned = 0.1 * away_s, 0.3 * away_s
            reports.sendto(f"0.3 {y} 0.2 {turned} 0 0 0 0 0".encode(), guard)
        assert link.cause is Cause.UNASKED
        assert control.recv(64) == b"off"


def test_a_guard_whose_process_has_ended_is_gone_at_the_next_beat(
    silent_guard: SilentGuard, link: GuardLink
) -> None:
    link.arm()
    link.beat(0)
    silent_guard.answer(Heartbeat(GuardMessage.ACKNOWLEDGEMENT, 1, 1))
    link.beat(1)
    assert link.alive(1)
    silent_guard.runs = False
    link.beat(2)
    assert not link.alive(2)


def test_the_memorys_name_is_gone_once_both_have_it(
    silent_guard: SilentGuard, link: GuardLink
) -> None:
    assert not list(Path("/dev/shm").glob(f"{silent_guard.name}*"))


class BrokenReports(ToldReports):
    """Reading them fails."""

    def newest(self, now_ns: int) -> ArmReport | None:
        raise RuntimeError("a mistake")


def test_a_guard_that_fails_while_it_watches_stops_the_arm_as_it_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stop, links = NotedStop(), []

    class Side:
        specification = guard_specification(ArmConfig(), LIMITS)
        stop_requested = threading.Event()

        def ready(self, memory: str, scheduler: str) -> None:
            link = GuardLink(GuardMemory(memory), NS_PER_S, lambda: True)
            link.arm()
            link.beat(0)
            links.append(link)

    monkeypatch.setattr(process, "HelperSide", Side)
    monkeypatch.setattr(process, "use_fifo", lambda _: "other")
    monkeypatch.setattr(process, "_stop_channel", lambda _: stop)
    monkeypatch.setattr(process, "_report_watch", lambda _: BrokenReports())
    with pytest.raises(RuntimeError, match="a mistake"):
        process.main()
    links[0].close()
    assert stop.stops == 1


# --- what the guard makes of beats and reports, in virtual time ---------------------------------


class VirtualGuard:
    """A guard that beats and reports reach every 10 ms, of an arm that moves along y."""

    def __init__(self, silent_guard: SilentGuard, link: GuardLink) -> None:
        self.beats = silent_guard.memory.beats
        self.link = link
        self.clock, self.stop, self.reports = VirtualClock(), NotedStop(), ToldReports()
        self.watch = HeartbeatWatch(TIMEOUT_NS)
        motion, memory = MotionWatch(motion_limits(ArmConfig(), LIMITS)), silent_guard.memory
        self.guard = Guard(memory, self.watch, motion, self.stop, self.reports, self.clock)

    def tick(self, y: float | None = 0.0, motion: Motion = Motion.REST, speed: float = 0.0) -> None:
        """`y`: of the report [m]; None for no report."""
        self.clock.advance_ns(10 * NS_PER_MS)
        self.link.beat(self.clock.now_ns(), motion, motion is not Motion.REST, speed)
        if y is not None:
            self.reports.told = ArmReport((0.3, y, 0.2), (3.0 * y, 0.6, 1.5, 0.0, 0.9, 0.0))
        self.guard.step()


@pytest.fixture
def virtual_guard(silent_guard: SilentGuard, link: GuardLink) -> VirtualGuard:
    return VirtualGuard(silent_guard, link)


@pytest.mark.parametrize("beats", [3, 1000])
def test_a_guard_that_was_held_up_hears_that_it_was_disarmed(
    virtual_guard: VirtualGuard, beats: int
) -> None:
    """It must not stop the arm for beats that it did not look at."""
    virtual_guard.link.arm()
    for now_ns in range(beats):
        virtual_guard.link.beat(now_ns)
    virtual_guard.guard.step()
    assert virtual_guard.watch.watch is GuardWatch.ARMED
    virtual_guard.link.disarm()
    for now_ns in range(beats, beats + 200):
        virtual_guard.link.beat(now_ns)
    virtual_guard.guard.step()
    assert virtual_guard.watch.watch is GuardWatch.IDLE
    assert virtual_guard.stop.stops == 0


def test_what_was_said_last_is_heard_at_the_end(virtual_guard: VirtualGuard) -> None:
    virtual_guard.link.arm()
    virtual_guard.tick()
    virtual_guard.link.close()
    virtual_guard.guard.farewell()
    assert virtual_guard.watch.watch is GuardWatch.IDLE
    assert virtual_guard.stop.stops == 0


def test_a_guard_whose_computer_slept_stops_an_armed_arm_and_says_why(
    virtual_guard: VirtualGuard,
) -> None:
    link, stop = virtual_guard.link, virtual_guard.stop
    virtual_guard.clock.suspend_ns(NS_PER_S)
    virtual_guard.guard.step()
    assert stop.stops == 0, "nothing is armed"
    link.arm()
    virtual_guard.tick()
    virtual_guard.clock.suspend_ns(NS_PER_S)
    virtual_guard.guard.step()
    virtual_guard.guard.step()
    link.beat(1)
    assert (stop.stops, link.latched, link.cause) == (1, True, Cause.SLEPT)


def test_a_guard_that_can_hear_no_more_stops_the_arm_as_it_ends(
    virtual_guard: VirtualGuard, monkeypatch: pytest.MonkeyPatch
) -> None:
    virtual_guard.link.arm()
    virtual_guard.tick()

    def fails() -> int:
        raise RuntimeError("a mistake")

    monkeypatch.setattr(virtual_guard.beats, "written", fails)
    with pytest.raises(RuntimeError, match="a mistake"):
        virtual_guard.guard.farewell()
    assert virtual_guard.stop.stops == 1


def test_an_arm_that_follows_as_the_beats_say_is_left_alone(virtual_guard: VirtualGuard) -> None:
    virtual_guard.link.arm()
    for number in range(100):
        virtual_guard.tick(0.002 * number, Motion.FOLLOW, 0.2)
    assert virtual_guard.stop.stops == 0
    assert virtual_guard.link.acknowledged
    assert not virtual_guard.link.latched


def test_an_arm_that_moves_while_the_beats_say_rest_is_stopped_once(
    virtual_guard: VirtualGuard,
) -> None:
    virtual_guard.link.arm()
    for _ in range(50):
        virtual_guard.tick()
    assert virtual_guard.stop.stops == 0
    for number in range(10):
        virtual_guard.tick(0.01 * number)
    assert virtual_guard.stop.stops == 1
    assert virtual_guard.link.cause is Cause.UNASKED


def test_an_arm_that_is_not_armed_may_move_as_others_like(virtual_guard: VirtualGuard) -> None:
    for number in range(100):
        virtual_guard.tick(0.01 * number)
    assert virtual_guard.stop.stops == 0


def test_an_arm_may_come_to_rest_within_the_first_300_ms_of_each_arming(
    virtual_guard: VirtualGuard,
) -> None:
    for _ in range(2):
        for _ in range(100):
            virtual_guard.tick()
        virtual_guard.link.arm()
        for number in range(50):
            virtual_guard.tick(0.001 * min(number, 10))
        virtual_guard.link.disarm()
    assert virtual_guard.stop.stops == 0


def test_an_arm_that_was_moved_between_two_armings_has_not_moved_unasked(
    virtual_guard: VirtualGuard,
) -> None:
    virtual_guard.link.arm()
    for _ in range(50):
        virtual_guard.tick()
    virtual_guard.link.disarm()
    virtual_guard.tick(0.05)
    virtual_guard.link.arm()
    for _ in range(50):
        virtual_guard.tick(0.1)
    assert virtual_guard.stop.stops == 0


@pytest.mark.parametrize(("arming", "sequence"), [(1, 1000), (2, 2)])
def test_a_late_beat_allows_no_motion(
    virtual_guard: VirtualGuard, arming: int, sequence: int
) -> None:
    """One of the arming before, or one that newer ones have overtaken."""
    virtual_guard.link.arm()
    virtual_guard.tick()
    virtual_guard.link.arm()
    for _ in range(50):
        virtual_guard.tick()
    late = beat(arming, sequence)._replace(motion=Motion.FOLLOW, deadman=True, speed=0.2)
    for number in range(10):
        virtual_guard.beats.put(late.encode())
        virtual_guard.tick(0.002 * number)
    assert virtual_guard.stop.stops == 1
    assert virtual_guard.link.cause is Cause.UNASKED


def test_the_guard_has_lost_the_arm_while_its_stop_would_not_get_through(
    virtual_guard: VirtualGuard,
) -> None:
    lost = []
    for failure in ("", "The stop connection does not answer.", ""):
        virtual_guard.stop.failure = failure
        virtual_guard.tick()
        virtual_guard.tick()
        lost.append(virtual_guard.link.arm_lost)
    assert lost == [False, True, False]


def test_the_guard_has_lost_the_arm_once_no_report_came_for_1200_ms(
    virtual_guard: VirtualGuard,
) -> None:
    virtual_guard.tick()
    for _ in range(120):
        virtual_guard.tick(None)
    virtual_guard.tick(None)  # which hears the answer to the one before
    assert not virtual_guard.link.arm_lost
    virtual_guard.tick(None)
    assert virtual_guard.link.arm_lost
    for _ in range(3):  # a report, the next answer after it, and the beat that hears that
        virtual_guard.tick()
    assert not virtual_guard.link.arm_lost


# --- the process's main function, in the test's own process -------------------------------------


Session: TypeAlias = Callable[[dict[str, Any]], None]


class GuardInThisProcess:
    """The `HelperSide` of a guard whose `main` runs in the calling thread."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.stop_requested = threading.Event()
        self.specification: dict[str, Any] = {}
        self.line: dict[str, Any] = {}
        self.priorities: list[int] = []
        self._attended: Future[None] | None = None
        monkeypatch.setattr(process, "HelperSide", lambda: self)
        monkeypatch.setattr(process, "use_fifo", self._grant)

    def run(self, config: ArmConfig, session: Session, **changes: float) -> dict[str, Any]:
        """Run it until `session` returns, which is called in another thread with the ready line.

        Returns that line.
        """
        self.specification = guard_specification(config, LIMITS) | changes
        with ThreadPoolExecutor(1) as self._threads:
            self._session = session
            process.main()
        if self._attended is not None:
            self._attended.result()
        return self.line

    def ready(self, **line: Any) -> None:
        self.line = line
        self._attended = self._threads.submit(self._attend)

    def fail(self, error: str) -> None:
        self.line = {"error": error}

    def _attend(self) -> None:
        try:
            self._session(self.line)
        finally:
            self.stop_requested.set()

    def _grant(self, priority: int) -> str:
        self.priorities.append(priority)
        return "granted"


@pytest.fixture
def guard_here(monkeypatch: pytest.MonkeyPatch) -> GuardInThisProcess:
    return GuardInThisProcess(monkeypatch)


def opened_link(ready: dict[str, Any]) -> GuardLink:
    return GuardLink(GuardMemory(ready["memory"]), NS_PER_S, lambda: True)


def beat_until(link: GuardLink, condition: Callable[[], bool]) -> bool:
    return until(lambda: link.beat(time.monotonic_ns()) or condition())


def test_the_guard_says_where_to_beat_watches_and_leaves_nothing_open(
    guard_here: GuardInThisProcess, rig: ControllerRig
) -> None:
    def stop_threads() -> list[str]:
        return [thread.name for thread in threading.enumerate() if thread.name == "guard-stop"]

    def session(ready: dict[str, Any]) -> None:
        assert stop_threads() == ["guard-stop"]
        link = opened_link(ready)
        link.arm()
        end_ns = time.monotonic_ns() + 150 * NS_PER_MS
        assert beat_until(link, lambda: time.monotonic_ns() > end_ns and link.acknowledged)
        assert not link.latched
        link.close()

    ready = guard_here.run(rig.config(), session, heartbeat_timeout_ms=1000.0)
    assert not rig.stopped
    assert ready["scheduler"] == "granted"
    assert guard_here.priorities == [GUARD_PRIORITY]
    assert stop_threads() == []
    assert not list(Path("/dev/shm").glob(f"{ready['memory']}*"))


def test_the_guard_stops_the_arm_for_a_silence_of_the_configured_time_and_says_so(
    guard_here: GuardInThisProcess, rig: ControllerRig
) -> None:
    def session(ready: dict[str, Any]) -> None:
        link = opened_link(ready)
        link.arm()
        began_ns = time.monotonic_ns()
        link.beat(began_ns)
        assert until(lambda: rig.stopped)
        assert time.monotonic_ns() - began_ns > 100 * NS_PER_MS
        assert beat_until(link, lambda: link.latched)
        assert link.cause is Cause.SILENT
        link.close()

    guard_here.run(rig.config(), session, heartbeat_timeout_ms=100.0)


def test_a_guard_that_ends_with_its_session_stops_an_armed_arm(
    guard_here: GuardInThisProcess, rig: ControllerRig
) -> None:
    def session(ready: dict[str, Any]) -> None:
        link = opened_link(ready)
        link.arm()
        assert beat_until(link, lambda: link.acknowledged)
        assert not rig.stopped

    guard_here.run(rig.config(), session, heartbeat_timeout_ms=10_000.0)
    assert rig.stopped


def test_a_stop_that_finds_no_arm_is_tried_until_there_is_one(
    guard_here: GuardInThisProcess, rig: ControllerRig
) -> None:
    def session(ready: dict[str, Any]) -> None:
        link = opened_link(ready)
        link.arm()
        rig.server.refuse_connections = True
        rig.server.drop_connections()
        link.beat(time.monotonic_ns())  # and then silence
        time.sleep(0.15)
        assert beat_until(link, lambda: link.arm_lost)
        assert not rig.stopped
        rig.server.refuse_connections = False
        assert until(lambda: rig.stopped)

    guard_here.run(rig.config(), session, heartbeat_timeout_ms=100.0)


def test_a_guard_that_reaches_no_arm_says_so_and_ends(guard_here: GuardInThisProcess) -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
        config = ArmConfig(host="127.0.0.1", control_port=port)
        line = guard_here.run(config, lambda _: None)
    assert list(line) == ["error"]
    assert line["error"].startswith(f"No arm answers at 127.0.0.1:{port}")


def test_a_guard_that_gets_no_reports_says_so_and_ends(
    guard_here: GuardInThisProcess, rig: ControllerRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    channels = []
    connect = process._stop_channel

    def kept(specification: dict[str, Any]) -> Any:
        channels.append(connect(specification))
        return channels[0]

    monkeypatch.setattr(process, "_stop_channel", kept)  # the end of the process closes it
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
        wrong = port - REAL_PORT_OFFSET
        line = guard_here.run(rig.config(), lambda _: None, report_port=wrong)
    channels[0].close()
    assert list(line) == ["error"]
    assert line["error"].startswith(f"The arm at 127.0.0.1 sends no reports on port {port}")
