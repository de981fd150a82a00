"""The session's small parts, each under a virtual clock or without any."""

import os
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tams_app.config import load_config
from tams_app.errors import LogError
from tams_app.records import Activity, ArmState, Frame, Pose, ServoMode, Twist
from tams_app.robot.control import CONFIRMED_AGO_NS, Signals, describe, lasting_label
from tams_app.robot.observers import StopWatch
from tams_app.robot.senders import Capture, FrameRates
from tams_app.rotation import Rotation
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.realtime import use_fifo
from tams_app.session.folder import create_session_folder, furnish_session_folder
from tams_app.session.recorders import LoadMonitor
from tams_app.teleop.records import TeleopOutput
from tams_app.teleop.safety import ArmingState, Reason, Request
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.session.exchange import MemoryJournal, Unkept
from tests.synthetic_session import tick

pytestmark = pytest.mark.waiting

MS = 1_000_000


def config(tmp_path, **overrides):
    return load_config(None, {"recording.directory": str(tmp_path), **overrides})


# --- folder -------------------------------------------------------------------------------------


def test_two_sessions_of_one_second_get_two_folders(tmp_path):
    now = time.struct_time((2026, 1, 2, 3, 4, 5, 0, 1, 0))
    first = create_session_folder(config(tmp_path), now)
    second = create_session_folder(config(tmp_path), now)
    assert (first.name, second.name) == ("20260102-030405-run", "20260102-030405-run-2")


def test_the_folder_holds_the_effective_configuration(tmp_path):
    settings = config(tmp_path, seed=5)
    folder = create_session_folder(settings)
    assert load_config(folder / "config.yaml") == settings


def test_a_full_disk_is_refused_before_anything_starts(tmp_path):
    with pytest.raises(LogError, match="MB are free"):
        create_session_folder(config(tmp_path, **{"recording.min_free_mb": 1e12}))


def test_a_folder_that_cannot_be_made_is_one_sentence(tmp_path):
    blocker = tmp_path / "file"
    blocker.write_text("")
    with pytest.raises(LogError, match="no session folder can be made"):
        create_session_folder(config(blocker))


def test_a_folder_that_is_there_already_is_furnished_like_one_of_ours(tmp_path):
    settings = config(tmp_path, seed=6)
    furnish_session_folder(settings, tmp_path)
    assert load_config(tmp_path / "config.yaml") == settings
    with pytest.raises(LogError, match="MB are free"):
        furnish_session_folder(config(tmp_path, **{"recording.min_free_mb": 1e12}), tmp_path)
    with pytest.raises(LogError):
        furnish_session_folder(settings, tmp_path / "none")


# --- signals ------------------------------------------------------------------------------------


def test_confirmations_and_stops_are_taken_once_and_faults_stay():
    signals = Signals()
    signals.confirm(0)
    signals.estop()
    signals.fault(Reason.GUARD_LOST)
    signals.fault(Reason.GUARD_LOST)
    first, second = signals.take(0), signals.take(0)
    assert (first.confirm, first.estop) == (True, True)
    assert (second.confirm, second.estop) == (False, False)
    assert first.faults == second.faults == (Reason.GUARD_LOST,)


def test_a_confirmation_counts_for_two_seconds_and_never_one_from_the_future() -> None:
    for ago_ns, counts in (
        (0, True),
        (CONFIRMED_AGO_NS, True),
        (CONFIRMED_AGO_NS + 1, False),
        (-51 * NS_PER_MS, False),
    ):
        signals = Signals()
        signals.confirm(10 * NS_PER_S)
        pending = signals.take(10 * NS_PER_S + ago_ns)
        assert (pending.confirm, pending.late_confirm) == (counts, not counts)
        again = signals.take(10 * NS_PER_S + ago_ns)
        assert (again.confirm, again.late_confirm) == (False, False)


# --- captures -----------------------------------------------------------------------------------


def test_every_frame_of_a_camera_is_handed_on():
    stop, seen = threading.Event(), []
    frames = [Frame("gt", index, 0, np.zeros((2, 2, 3), np.uint8)) for index in (0, 1, 4)]
    left = iter(frames)

    def next_frame(timeout_s):
        frame = next(left, None)
        if frame is None:
            stop.set()
        return frame

    camera, video = SimpleNamespace(next_frame=next_frame), SimpleNamespace(push=seen.append)
    rates = FrameRates(("gt",), VirtualClock(), MemoryJournal(VirtualClock()))
    Capture(camera, rates, video).run(stop)
    assert seen == frames


# --- stops --------------------------------------------------------------------------------------


def arm_at(x_m, received_ns):
    pose = Pose(np.array([x_m, 0.0, 0.2]), Rotation.identity())
    return ArmState(received_ns, np.zeros(6), pose, Activity.MOVING, ServoMode.VELOCITY, None, None)


def output(arming, reason=None):
    return TeleopOutput(
        twist=Twist.zero(),
        gripper=None,
        stop=False,
        request=Request.NONE,
        arming=arming,
        reason=reason,
        detail="",
        deadman=True,
        orientation_mode=False,
        speed_scale=1.0,
        braking=False,
        haptic=None,
    )


def inputs(now_ns=0, arm=None):
    """What observers read of a tick's inputs."""
    return SimpleNamespace(now_ns=now_ns, arm=arm)


def after(decided, now_ns=0):
    """The tick in which this was decided."""
    return replace(
        tick(0),
        due_ns=now_ns,
        started_ns=now_ns,
        arming=decided.arming.value,
        reason=describe(decided),
        lasting=lasting_label(decided),
        stop=decided.stop,
        deadman=decided.deadman,
        twist=decided.twist or Twist.zero(),
    )


def test_a_stop_lasts_from_the_fault_to_the_report_of_an_arm_at_rest():
    watch, records = StopWatch(), []
    holding = output(ArmingState.HOLDING, Reason.STALE_VIDEO)
    records += watch.step(inputs(0, arm_at(0.300, 0)), output(ArmingState.ENGAGED))
    records += watch.step(inputs(8 * MS, arm_at(0.301, 8 * MS)), holding)
    records += watch.step(inputs(16 * MS, arm_at(0.3015, 16 * MS)), holding)
    records += watch.step(inputs(24 * MS, arm_at(0.3015, 24 * MS)), holding)
    (stop,) = records
    assert (stop.reason, stop.visible_ns, stop.stopped_ns) == ("stale video", 8 * MS, 24 * MS)


def test_releasing_the_trigger_is_no_stop():
    watch, records = StopWatch(), []
    records += watch.step(inputs(0, arm_at(0.3, 0)), output(ArmingState.ENGAGED))
    records += watch.step(inputs(8 * MS, arm_at(0.3, 8 * MS)), output(ArmingState.READY))
    records += watch.step(inputs(16 * MS, arm_at(0.3, 16 * MS)), output(ArmingState.READY))
    assert records + watch.finish() == []


def test_a_stop_whose_end_was_not_seen_is_recorded_as_such():
    watch, arm = StopWatch(), arm_at(0.3, 0)
    assert watch.step(inputs(0, arm), output(ArmingState.ENGAGED)) == []
    fault = output(ArmingState.FAULT, Reason.ARM_SILENT)
    assert watch.step(inputs(8 * MS, arm), fault) == []
    (stop,) = watch.finish()
    assert stop.stopped_ns is None


# --- load, priority -------------------------------------------------------------------------------


def test_load_counts_the_application_and_its_helpers_even_dead_ones():
    monitor = LoadMonitor(VirtualClock(), {"self": os.getpid()}, Unkept(VirtualClock()))
    sample = monitor.sample()
    assert set(sample.helper_cpu_percent) == {"self"}
    assert sample.rss_mb > 2 * 10  # this process, counted as application and as helper


def test_no_priority_is_asked_for_when_the_configuration_says_zero():
    assert use_fifo(0) == "other: not asked for"
