"""The hardware profile, driven for real and with the product's limits.

Faked is only what lies beyond the wire, and it has processes of its own (`hardware_station`): the
arm is the rig's controller model behind TCP, SteamVR the function tables of a scripted runtime,
the cameras are played below v4l2src.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from hw.lite6.protocol import State
from tams_app.errors import TamsError
from tams_app.recording import read_log
from tests.further import further
from tests.session.hardware_station import (
    PATIENCE_S,
    REACH_M,
    Plugged,
    Station,
    station,
    witness,
)

pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(300),
]
FPS = 15  # what two slow cores have time for, of three cameras


@pytest.fixture
def there(tmp_path: Path) -> Iterator[Plugged]:
    with closing(Plugged(tmp_path, FPS)) as found:
        yield found


def drive(here: Station) -> float:
    """How far [m] the arm followed."""
    here.await_frames()
    here.make_ready()
    return here.reach()


def test_a_hand_in_steamvr_moves_a_lite6_and_three_cameras_are_streamed(there: Plugged) -> None:
    with witness(there) as arm:
        with station(there, there.config()) as here:
            assert drive(here) > REACH_M, here.seen
        assert arm.wait_for(lambda: arm.motion.state == State.STOPPED, PATIENCE_S)
    assert here.failure == ""
    log = read_log(here.folder / "session.mcap")
    assert log.outcome is not None
    assert (log.outcome.completed, log.outcome.reason) == (None, "ended by the operator")
    assert {shown.view for shown in log.shown} == {"eih", "gt", "gs"}


@pytest.mark.verify
def test_a_dry_run_does_everything_but_move_the_arm(there: Plugged) -> None:
    with witness(there) as arm:
        joints = arm.motion.joints
        with station(there, there.config(), dry_run=True) as here:
            assert drive(here) > REACH_M  # of the model
            np.testing.assert_allclose(arm.motion.joints, joints, atol=1e-6)
            assert not arm.status.motors_enabled
    assert here.failure == ""


def test_a_runtime_that_quits_stops_the_arm_and_says_so(there: Plugged) -> None:
    with witness(there) as arm, station(there, there.config()) as here:
        here.await_frames()
        here.make_ready()
        assert arm.wait_for(lambda: arm.motion.state != State.STOPPED, PATIENCE_S)
        here.quit_steamvr()
        here.until(lambda: here.arming == "fault", "a fault")
        assert "VR runtime quit" in here.seen.state.reason
        assert arm.wait_for(lambda: arm.motion.state == State.STOPPED, PATIENCE_S)


@pytest.mark.parametrize("dry_run", [True, *further(False)])
def test_an_arm_at_the_factorys_home_is_sent_home_and_not_enabled(
    tmp_path: Path, dry_run: bool
) -> None:
    def refusals(here: Station) -> list[str]:
        return [note for note in here.notes if "outside the workspace" in note]

    with (
        closing(Plugged(tmp_path, FPS, [0.0] * 6)) as there,
        witness(there) as arm,
        station(there, there.config(), dry_run) as here,
    ):
        here.confirm_until(lambda: bool(refusals(here)), "a refusal")
        assert here.arming == "disarmed"
        assert not arm.status.motors_enabled
    assert refusals(here)[0].endswith("run `run_tams.py home` first")


@pytest.mark.parametrize("missing", ["arm", *further("controller")])
def test_a_missing_device_is_one_sentence_and_nothing_is_left_behind(
    there: Plugged, missing: str
) -> None:
    if missing == "arm":
        there.arm.stop()
    with pytest.raises(TamsError) as refusal:
        Station(there, there.config(), there.wiring(missing != "controller"), dry_run=False)
    assert len(str(refusal.value).splitlines()) == 1
