"""Processor time by thread and process, read while a program runs and told by its part of it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import named_threads
from benchmarks.processor_time import (
    Profile,
    Sample,
    group,
    helper_name,
    thread_s,
    watch,
)

pytestmark = pytest.mark.waiting

# Threads and a helper that take 0.3 s of processor time each, and stay for the last sample.
PROGRAM = """
import subprocess, sys, threading, time

def work():
    time.sleep(0.5)
    until = time.thread_time() + 0.3
    while time.thread_time() < until:
        pass
    helper.wait()
    time.sleep(1)

helper = subprocess.Popen([sys.executable, "-m", "rig"])
names = ("control", "frames:src", "jitterbuffer:src", "capture-eih", "capture-gt")
threads = [threading.Thread(target=work, name=name) for name in names]
for thread in threads:
    thread.start()
"""
RIG = """
import time
time.sleep(1)
while time.process_time() < 0.3:
    pass
time.sleep(1)
"""


def sample(t_s: float, threads: dict[int, tuple[str, float]], **changes: object) -> Sample:
    """A moment of a session whose threads encode and decode all the time."""
    video = {2: ("frames:src", t_s / 10), 3: ("jitterbuffer:sr", t_s / 20)}
    given = {"application_s": t_s, "helpers": {"rig": t_s / 4}, "machine_s": 2 * t_s, **changes}
    return Sample(round(t_s * 1e9), threads={**video, **threads}, **given)


def test_a_threads_time_is_exact_to_the_nanosecond() -> None:
    assert thread_s("1500000001 2482670 2\n") == 1.500000001


@pytest.mark.parametrize(
    ("name", "counted"),
    [
        ("capture-gt", "capture"),
        ("Thread-3 (_recv", "unnamed"),
        ("python", "unnamed"),
        ("arm-report", "arm-report"),
        ("frames:src", "frames:src"),
    ],
)
def test_threads_of_all_views_count_as_one(name: str, counted: str) -> None:
    assert group(name) == counted


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("hw.sim.rig", "rig"),
        ("hw.sim.renderer", "renderer"),
        ("hw.sim.world.renderer", "renderer"),
        ("hw.guard", "guard"),
        ("hw.guard.process", "guard"),
        ("tams_app.station.quality_process", "quality"),
        ("tams_app.video.live.relay", "relay"),
    ],
)
def test_a_helper_has_the_same_name_in_every_checkout(module: str, name: str) -> None:
    assert helper_name(["/usr/bin/python3", "-m", module, "{}"]) == name


def test_what_is_no_module_has_its_programs_name() -> None:
    assert helper_name(["/usr/bin/git", "-m"]) == "git"
    assert helper_name([]) == "ended"  # a process that has just ended has no command


def test_only_the_time_of_the_control_loop_counts() -> None:
    control = {4: ("control", 0.0)}
    profile = Profile.of(
        [
            sample(1, {}),
            sample(2, {**control, 9: ("main", 5.0)}),
            sample(3, {**control, 9: ("main", 5.5)}),
            sample(4, {9: ("main", 7.5)}),
        ]
    )
    assert profile.seconds == 1
    assert profile.application_s == 1
    assert profile.threads["main"] == pytest.approx(0.5)
    assert profile.encoding_s == pytest.approx(0.1)
    assert profile.decoding_s == pytest.approx(0.05)
    assert profile.helpers == {"rig": 0.25}
    assert profile.others_s == pytest.approx(0.75)  # of 2 s on two cores


def test_threads_that_come_and_go_count_with_what_was_seen_of_them() -> None:
    control = {4: ("control", 0.0)}
    seen = [
        sample(1, {**control, 5: ("load", 1.0), 6: ("load", 0.5)}),
        sample(2, {**control, 5: ("load", 1.5), 6: ("load", 0.5), 7: ("later", 0.25)}),
        sample(3, {**control, 6: ("load", 0.5), 7: ("later", 0.75)}),
    ]
    threads = Profile.of(seen).threads
    assert threads["load"] == pytest.approx(0.5)
    assert threads["later"] == pytest.approx(0.75)


def test_a_session_without_its_control_loop_or_its_video_has_no_profile() -> None:
    with pytest.raises(RuntimeError, match="control loop did not run"):
        Profile.of([sample(1, {}), sample(2, {})])
    mute = [Sample(t, t, {4: ("control", 0.0), 2: ("frames:src", t)}, {}, t) for t in (1, 2)]
    with pytest.raises(RuntimeError, match="none that decodes among control, frames:src"):
        Profile.of(mute)


def test_a_programs_threads_are_told_apart_from_outside(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM, encoding="utf-8")
    (tmp_path / "rig.py").write_text(RIG, encoding="utf-8")
    command = [sys.executable, named_threads.__file__, "program.py"]
    with subprocess.Popen(command, cwd=tmp_path) as process:
        profile = Profile.of(watch(process, interval_s=0.05))
    assert process.returncode == 0
    assert profile.threads["control"] == pytest.approx(0.3, abs=0.1)
    assert profile.threads["capture"] == pytest.approx(0.6, abs=0.15)
    assert profile.encoding_s == pytest.approx(0.3, abs=0.1)
    assert profile.decoding_s == pytest.approx(0.3, abs=0.1)
    assert profile.helpers["rig"] == pytest.approx(0.3, abs=0.1)
    assert profile.application_s == pytest.approx(sum(profile.threads.values()), abs=0.1)
