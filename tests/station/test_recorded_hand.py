"""From a session's log to the hand that moves again."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest

from tams_app.config import load_config
from tams_app.errors import ConfigError, LogError
from tams_app.recording.writer import DirectRecorder
from tams_app.robot.session_records import SessionRecords
from tams_app.runtime.clock import VirtualClock
from tams_app.runtime.parts import Parts
from tams_app.station.displays import Displays
from tams_app.station.recorded_hand import ReplayedController, recorded_hand
from tams_app.station.station import Station
from tests.synthetic_session import PERIOD_NS, START_NS, header, tick

pytestmark = pytest.mark.untimed


class Unkept:
    def record(self, item):
        pass


def write(path, count):
    with closing(DirectRecorder(path, header(), VirtualClock(START_NS), 0)) as log:
        for number in range(count):
            log.record(tick(number))
    return path


def test_the_hand_of_a_log_moves_as_it_was_recorded(tmp_path):
    controller = recorded_hand(write(tmp_path / "session.mcap", 40))
    controller.start()
    for number in range(40):
        sample = controller.sample(10 * START_NS + number * PERIOD_NS)
        expected = tick(number).controller
        np.testing.assert_allclose(sample.pose.position, expected.pose.position, atol=1e-9)
        assert sample.trigger == expected.trigger


def test_a_log_without_a_hand_and_a_file_that_is_none_are_one_sentence(tmp_path):
    with pytest.raises(ConfigError, match=r"rig\.hand_trajectory: .* holds no tick"):
        recorded_hand(write(tmp_path / "session.mcap", 0))
    (tmp_path / "other.mcap").write_bytes(b"none of ours")
    with pytest.raises(LogError, match=r"other\.mcap"):
        recorded_hand(tmp_path / "other.mcap")


def test_the_live_operator_takes_the_configured_hand(tmp_path):
    path = write(tmp_path / "session.mcap", 3)
    config = load_config(None, {"rig.hand_trajectory": str(path)})
    clock = VirtualClock()
    log = SessionRecords(clock, Unkept())
    station = Station(config, clock, Parts(tmp_path, pytest.fail, 0), log, Displays(), True)
    station.launch()
    assert isinstance(station.take_controller(), ReplayedController)


@pytest.mark.parametrize(("is_rig", "what"), [(True, "rig"), (False, "arm")])
def test_a_person_is_told_whether_they_drive_the_rig_or_an_arm(tmp_path, is_rig, what):
    config = load_config(None, {"controller.device": "keyboard"})
    told = []
    log = SessionRecords(VirtualClock(), Unkept(), show=told.append)
    parts = Parts(tmp_path, pytest.fail, 0)
    Station(config, VirtualClock(), parts, log, Displays(), is_rig).wait_ready()
    assert told == [f"a person drives the {what}: keyboard"]
