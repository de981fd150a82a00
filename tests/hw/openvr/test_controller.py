import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import openvr
import pytest

from hw.openvr import controller as openvr_controller
from hw.openvr.bindings import COMMITTED_DIRECTORY
from hw.openvr.controller import OpenVrController
from tams_app.config import ControllerConfig
from tams_app.errors import ConfigError, DeviceError, TamsError
from tams_app.records import ControllerSample, ControllerStatus, Haptic
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.hw.openvr.fake_openvr import RIGHT, FakeRuntime, until

pytestmark = pytest.mark.waiting

CLOCK = MonotonicClock()
WITHIN_S = 20.0


@pytest.fixture
def fake(fake):
    fake.devices[RIGHT].trembles = True
    return fake


@pytest.fixture
def notes():
    return []


@pytest.fixture
def controller(fake, notes):
    controller = OpenVrController(ControllerConfig(), CLOCK, lambda *note: notes.append(note))
    yield controller
    fake.flow()
    controller.close()


def fail(*_: object) -> None:
    raise RuntimeError("a broken thing")


def is_old(sample: ControllerSample) -> bool:
    return CLOCK.now_ns() - sample.pose_ns > 200 * NS_PER_MS


def test_a_runtime_that_hangs_holds_nothing_up_and_lets_the_times_grow_old(controller, fake):
    controller.start()
    fake.press("trigger")
    until(controller, lambda sample: sample.trigger == 1.0)
    fake.hang()
    first = until(controller, is_old)
    for haptic in list(Haptic) * 20:
        controller.pulse(haptic)
    assert controller.sample(CLOCK.now_ns()) is first
    fake.flow()
    resumed_ns = CLOCK.now_ns()
    until(controller, lambda s: min(s.pose_ns, s.buttons_ns) > resumed_ns)


def test_a_runtime_that_hangs_at_the_start_is_a_device_error(controller, fake, monkeypatch):
    monkeypatch.setattr(openvr_controller, "START_TIMEOUT_S", 0.1)
    fake.hang()
    with pytest.raises(DeviceError, match="not answered"):
        controller.start()
    with pytest.raises(DeviceError, match="still open"):
        controller.start()


def test_what_a_hung_runtime_answers_after_the_close_is_not_taken(controller, fake, monkeypatch):
    controller.start()
    fake.hang()
    until(controller, is_old)  # the thread waits for the runtime
    monkeypatch.setattr(openvr_controller.Worker.stop, "__defaults__", (0.1,))
    with pytest.raises(TamsError, match="openvr-poll"):
        controller.close()
    fake.flow()
    deadline_ns = CLOCK.now_ns() + round(WITHIN_S * NS_PER_S)
    while fake.connections:
        assert CLOCK.now_ns() < deadline_ns
        time.sleep(0.01)
    assert controller.sample(CLOCK.now_ns()).status is ControllerStatus.DISCONNECTED


def test_the_end_of_the_thread_is_told_and_reads_as_disconnected(
    controller, fake, notes, monkeypatch
):
    controller.start()
    fake.press("trigger")
    last = until(controller, lambda sample: sample.trigger == 1.0)

    monkeypatch.setattr(openvr_controller.OpenVrPoller, "step", fail)
    sample = until(controller, lambda s: s.status is ControllerStatus.DISCONNECTED)
    assert (sample.pose, sample.trigger) == (None, 0.0)
    assert sample.buttons_ns >= last.buttons_ns
    assert "a broken thing" in controller.failure
    assert ("error", controller.failure) in notes
    assert fake.connections == 0


def test_an_unexpected_end_during_the_start_is_a_device_error(controller, fake, monkeypatch):
    monkeypatch.setattr(openvr_controller.OpenVrPoller, "step", fail)
    with pytest.raises(DeviceError, match="a broken thing"):
        controller.start()


def test_the_thread_has_a_name_and_a_kernel_id(controller):
    assert controller.realtime_thread_ids == {}
    controller.start()
    assert isinstance(controller.realtime_thread_ids["openvr-poll"], int)


def test_default_mappings_are_read_from_the_committed_folder(controller, fake, monkeypatch):
    seen = spy_on_manifest(fake, monkeypatch)
    controller.start()
    assert seen() == COMMITTED_DIRECTORY / "actions.json"


def test_a_mapping_of_ones_own_has_its_folder_as_long_as_it_is_in_use(fake, notes, monkeypatch):
    seen = spy_on_manifest(fake, monkeypatch)
    config = ControllerConfig.model_validate(
        {"mapping": {"knuckles": {"menu": "a/click", "a": "thumbstick/click"}}}
    )
    controller = OpenVrController(config, CLOCK, lambda *note: notes.append(note))
    controller.start()
    path = seen()
    content = json.loads((path.parent / "bindings_knuckles.json").read_text())
    (source,) = (
        s
        for s in content["bindings"]["/actions/tams"]["sources"]
        if s["path"] == "/user/hand/right/input/thumbstick"
    )
    assert source["inputs"]["click"]["output"] == "/actions/tams/in/a"
    controller.close()
    assert not path.parent.exists()


def test_a_start_that_fails_leaves_no_folder_behind(fake, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    fake.running = False
    config = ControllerConfig.model_validate({"mapping": {"knuckles": {"grip": "grip/force"}}})
    with pytest.raises(DeviceError, match="not running"):
        OpenVrController(config, CLOCK, lambda *_: None).start()
    assert list(tmp_path.iterdir()) == []


def test_a_mapping_that_cannot_be_is_refused_before_anything_starts():
    config = {"mapping": {"knuckles": {"menu": "a/click"}}}
    with pytest.raises(ConfigError, match="both a and menu"):
        OpenVrController(ControllerConfig.model_validate(config), CLOCK, lambda *_: None)


def spy_on_manifest(fake: FakeRuntime, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Path]:
    """What path the runtime was given."""
    paths: list[str] = []
    original = openvr.IVRInput.setActionManifestPath

    def spy(self: object, path: str) -> None:
        paths.append(path)
        original(self, path)

    monkeypatch.setattr(openvr.IVRInput, "setActionManifestPath", spy)
    return lambda: Path(paths[-1])
