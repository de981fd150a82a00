"""What a log tells of its cameras, and what it says it does not."""

import numpy as np
import pytest

from calibration.cameras.wizard import CameraWizard
from calibration.options import CameraOptions
from tams_app.errors import LogError
from tams_app.recording import Recorder, ReferenceRecorder
from tams_app.records import Frame
from tams_app.runtime.clock import MonotonicClock
from tests.scripted_ui import ScriptedUI
from tests.synthetic_session import VIEWS, capture_ns, header, live_records

pytestmark = pytest.mark.waiting

SECONDS = 3.0


def never_fails(name, failure):
    raise AssertionError(f"{name}: {failure!r}")


@pytest.fixture
def folder(tmp_path):
    recorder = Recorder(tmp_path / "session.mcap", header(), MonotonicClock(), 0, never_fails)
    recorder.start()
    for record in live_records(SECONDS, video_bytes=200):
        recorder.record(record)
    recorder.close()
    return tmp_path


def add_reference(folder):
    recorder = ReferenceRecorder(folder / "reference.mcap", header().wall_offset_ns, 0, never_fails)
    random = np.random.default_rng(1)
    for index in range(10):
        for view in VIEWS:
            level = 252 if view == "gs" else 110
            image = random.integers(level - 3, level + 4, (240, 320, 3)).astype(np.uint8)
            recorder.record(Frame(view, index, capture_ns(index), image))
    recorder.start()
    recorder.close()


def told(folder):
    ui = ScriptedUI()
    assert CameraWizard(ui, CameraOptions(logs=[folder])).run() == 0
    return "\n".join(ui.said)


def test_the_rate_comes_from_the_log_and_the_rest_is_said_to_be_missing(folder):
    text = told(folder)
    for view in VIEWS:
        assert f"{view.upper()}: 30.00 Hz, 0 missed" in text
    assert "has no reference.mcap, so focus and exposure cannot be told" in text
    assert "A log does not tell which camera is which" in text


def test_light_and_focus_come_from_the_reference_captures(folder):
    add_reference(folder)
    text = told(folder)
    assert "has no reference.mcap" not in text
    gs = next(line for line in text.splitlines() if line.startswith("GS: 30.00 Hz"))
    gt = next(line for line in text.splitlines() if line.startswith("GT: 30.00 Hz"))
    assert "too bright" in gs
    assert "too bright" not in gt
    assert "nothing to focus on" in gt


def test_a_folder_without_a_session_is_one_sentence(tmp_path):
    with pytest.raises(LogError, match=r"session\.mcap"):
        CameraWizard(ScriptedUI(), CameraOptions(logs=[tmp_path])).run()
