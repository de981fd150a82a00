"""The servo's arithmetic on a model of x264, and the loop on the real one."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import VideoConfig
from tams_app.records import DroppedFrame
from tams_app.runtime.clock import MonotonicClock
from tams_app.video.rate_control import WINDOW_FRAMES, EncoderServo
from tams_app.video.sender import VideoSender
from tams_app.video.udp import ViewPorts
from tests.video.scenes import frame

pytestmark = pytest.mark.waiting

FPS = 30


def run_model(
    targets_kbps: list[float], yields: float, repair_share: float = 0.0
) -> tuple[list[float], list[int]]:
    """Wire rate [kbit/s] of each frame and the bitrates asked for, when the encoder delivers
    `yields` of its bitrate and `repair_share` of the bytes are sent again."""
    servo = EncoderServo(FPS, 1200)
    sent, rates, asked = 0, [], []
    for target_kbps in targets_kbps:
        bitrate = servo.step(sent, target_kbps)
        wire = bitrate * 1000 / 8 / FPS * yields * 1.05 * (1 + repair_share)
        sent += round(wire)
        rates.append(wire * 8 * FPS / 1000)
        asked.append(bitrate)
    return rates, asked


@given(st.floats(0.75, 1.15), st.floats(100.0, 8000.0))
def test_an_encoder_that_misses_its_bitrate_is_brought_to_the_target(
    yields: float, target_kbps: float
) -> None:
    rates, _ = run_model([target_kbps] * 90, yields)
    assert np.mean(rates[-30:]) == pytest.approx(target_kbps, rel=0.03)


@given(st.floats(0.0, 0.4))
def test_media_gives_way_to_repair_so_that_the_sum_meets_the_target(repair_share: float) -> None:
    rates, asked = run_model([1500.0] * 120, 0.9, repair_share)
    _, asked_without = run_model([1500.0] * 120, 0.9)
    assert np.mean(rates[-30:]) == pytest.approx(1500.0, rel=0.03)
    assert asked[-1] <= asked_without[-1] + 15


def test_a_step_of_the_target_takes_effect_with_the_next_frame() -> None:
    rates, _ = run_model([600.0] * 60 + [3000.0] * 8, 0.85)
    assert np.mean(rates[60:]) == pytest.approx(3000.0, rel=0.10)


def test_many_small_changes_do_not_keep_the_servo_from_learning() -> None:
    targets = [1500.0 * (1 + 0.04 * np.sin(n)) for n in range(120)]
    rates, _ = run_model(targets, 0.8)
    assert np.mean(rates[-40:]) == pytest.approx(np.mean(targets[-40:]), rel=0.03)


def test_a_still_frame_does_not_wind_the_servo_up() -> None:
    servo = EncoderServo(FPS, 1200)
    sent = 0
    for _ in range(300):
        bitrate_still = servo.step(sent, 2000.0)
        sent += 500  # a still scene needs 6 % of its target
    for _ in range(WINDOW_FRAMES):  # now the scene fills what it may
        bitrate = servo.step(sent, 2000.0)
        sent += round(bitrate * 1000 / 8 / FPS)
    assert bitrate_still <= 3100
    assert servo.step(sent, 2000.0) <= 2200


def test_one_burst_of_repair_does_not_starve_the_encoder() -> None:
    servo = EncoderServo(FPS, 1200)
    sent = 0
    for _ in range(60):
        usual = servo.step(sent, 1000.0)
        sent += 4167
    sent += 10 * 4167
    assert servo.step(sent, 1000.0) >= 0.35 * usual


@given(st.lists(st.tuples(st.floats(0.0, 20_000.0), st.integers(0, 10**6)), max_size=60))
def test_whatever_happens_the_bitrate_stays_near_the_target(
    steps: list[tuple[float, int]],
) -> None:
    servo = EncoderServo(FPS, 1200)
    sent = 0
    for target_kbps, burst in steps:
        sent += burst
        assert 1 <= servo.step(sent, target_kbps) <= max(1.0, 1.51 * target_kbps)


# --- with the real encoder ----------------------------------------------------------------------


class LockStep:
    """A sender whose every frame is taken from the wire before the next is pushed."""

    def __init__(self, sender: VideoSender, wire: socket.socket) -> None:
        self.sender = sender
        self.frame_bytes: list[int] = []
        self._wire = wire

    def push(self, index: int) -> None:
        dropped = self.sender.stats().frames_dropped
        self.sender.push(frame(index))
        marker, size = self.sender.stats().frames_dropped > dropped, 0
        while not marker:
            datagram = self._wire.recv(2048)
            size += len(datagram) + 28
            marker = bool(datagram[1] & 0x80)
        self.frame_bytes.append(size)
        while self.sender.stats().wire_bytes < sum(self.frame_bytes):
            pass  # the udpsink counts just after it sent

    def windows_kbps(self) -> np.ndarray:
        """Rate of each run of eight frames."""
        kbits = np.array(self.frame_bytes) * 8 / 1000
        return np.convolve(kbits, np.ones(WINDOW_FRAMES), "valid") * FPS / WINDOW_FRAMES


@contextmanager
def lock_step(start_kbps: float) -> Iterator[LockStep]:
    dropped: list[DroppedFrame] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 21)
        wire.bind(("127.0.0.1", 0))
        wire.settimeout(20)
        sender = VideoSender(
            "eih", VideoConfig(), True, MonotonicClock(), start_kbps, 80.0,
            lambda encoded: None, dropped.append,
        )  # fmt: skip
        port = wire.getsockname()[1]
        sender.start(ViewPorts("127.0.0.1", port, sender.feedback_port, port))
        try:
            yield LockStep(sender, wire)
        finally:
            sender.close()


def test_the_real_encoder_tracks_steps_of_its_target() -> None:
    schedule = {0: 1000, 60: 3000, 120: 600, 180: 300, 240: 150}
    with lock_step(schedule[0]) as run:
        for index in range(300):
            if index in schedule:
                run.sender.set_target_kbps(schedule[index])
            run.push(index)
        assert run.sender.stats().wire_bytes == sum(run.frame_bytes)
    rates = run.windows_kbps()
    for start, target_kbps in schedule.items():
        error = np.abs(rates[start : start + 60 - WINDOW_FRAMES + 1] / target_kbps - 1)
        unsettled = np.flatnonzero(error > 0.15)
        settled = unsettled[-1] + 1 if unsettled.size else 0
        assert settled <= 8, f"{target_kbps} kbit/s settled after {settled} frames"
        assert error[15:].mean() <= 0.05


def test_below_the_threshold_frames_are_dropped_and_the_rate_still_meets_the_target() -> None:
    with lock_step(50.0) as run:
        for index in range(180):
            run.push(index)
        dropped = run.sender.stats().frames_dropped
    assert dropped == pytest.approx(180 * 3 / 8, abs=2)
    sent_kbps = sum(run.frame_bytes[30:]) * 8 / 1000 / (150 / FPS)
    assert sent_kbps == pytest.approx(50.0, rel=0.06)
