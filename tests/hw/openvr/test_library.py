"""Once through the real libopenvr_api: path registry, client library, tokens, interface look-up."""

import ctypes
import json
import os
import platform
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import openvr
import pytest

from hw.openvr.controller import OpenVrController
from hw.openvr.devices import list_controllers
from hw.openvr.overlays import Overlays
from hw.openvr.runtime import OpenVrRuntime
from tams_app.config import ControllerConfig
from tams_app.errors import DeviceError
from tams_app.records import ControllerStatus, Haptic
from tams_app.runtime.clock import MonotonicClock
from tests.hw.openvr.fake_openvr import HEADSET, RIGHT, FakeRuntime, until

COMPILER = shutil.which("g++")
SOURCE = Path(__file__).parent / "vrclient.cpp"
CLOCK = MonotonicClock()

pytestmark = [
    pytest.mark.waiting,
    pytest.mark.skipif(COMPILER is None, reason="g++ is needed to build a runtime library"),
    pytest.mark.skipif(
        (platform.system(), platform.machine()) != ("Linux", "x86_64"),
        reason="the runtime library of this test is laid out for Linux on x86-64",
    ),
]


@pytest.fixture(scope="module")
def client_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A runtime's folder with the client library that libopenvr_api looks for."""
    library = tmp_path_factory.mktemp("runtime") / "bin" / "linux64" / "vrclient.so"
    library.parent.mkdir(parents=True)
    command = [str(COMPILER), "-shared", "-fPIC", "-O1", "-Wall", "-o", str(library), str(SOURCE)]
    subprocess.run(command, check=True, timeout=100)
    return library


@pytest.fixture
def no_registry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A path registry that is not there."""
    registry = tmp_path / "openvrpaths.vrpath"
    monkeypatch.setenv("VR_PATHREG_OVERRIDE", str(registry))
    monkeypatch.delenv("VR_OVERRIDE", raising=False)
    return registry


@pytest.fixture
def fake(client_library: Path, no_registry: Path, tmp_path: Path) -> Iterator[FakeRuntime]:
    """A runtime that is installed as SteamVR would be."""
    paths = {key: [str(tmp_path)] for key in ("config", "log")}
    runtime_folder = str(client_library.parents[2])
    content = {"jsonid": "vrpathreg", "runtime": [runtime_folder], "version": 1, **paths}
    no_registry.write_text(json.dumps(content))
    fake = FakeRuntime()
    library = ctypes.CDLL(str(client_library), mode=os.RTLD_NOW)
    init_error = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int)(fake.init_error)
    interface = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_char_p)(
        lambda name: fake.interface(name.decode())
    )
    library.set_provider(init_error, interface)
    with fake.in_place_of_structures():
        yield fake
    library.set_provider(None, None)


def test_the_whole_driver_runs_through_the_real_library(fake):
    fake.devices[RIGHT].trembles = True
    fake.press("trigger", 0.5)
    with closing(OpenVrController(ControllerConfig(), CLOCK, lambda *_: None)) as controller:
        controller.start()
        sample = controller.sample(CLOCK.now_ns())
        assert sample.status is ControllerStatus.OK
        assert sample.trigger == 0.5
        assert sample.pose is not None
        controller.pulse(Haptic.ENGAGE)
        until(controller, lambda _: bool(fake.vibrations))
        fake.quit()
        until(controller, lambda s: s.status is ControllerStatus.RUNTIME_QUIT)
        fake.restart()
        until(controller, lambda s: s.status is ControllerStatus.OK)
    assert fake.quits_acknowledged == 1
    assert not fake.launched
    join = [openvr.VRApplication_Background, openvr.VRApplication_Overlay]
    assert fake.joined_as[:2] == join
    assert fake.joined_as[-2:] == join


def test_controllers_are_listed_through_the_real_library(fake):
    assert [info.serial for info in list_controllers()] == ["CTL_RIGHT", "CTL_LEFT"]


def test_overlays_are_made_through_the_real_library(fake):
    fake.overlays.reads_back = False
    fake.devices[HEADSET].put((0.0, 1.6, 0.0))
    with closing(OpenVrRuntime.join()) as runtime:
        overlays = Overlays(runtime, ("front",), follow_head=False)
        overlays.arrange(0, np.eye(4), 1.1)
        overlays.crop(0, 0.0, 0.25, 0.5, 0.75)
        overlays.submit(0, 7)
        assert overlays.look() == ""
    made = fake.overlays.of("tams.front")
    assert (made.shown, made.of, made.submitted) == (True, "room", 1)
    assert made.bounds == (0.0, 0.75, 0.5, 0.25)
    assert made.transform[1, 3] == pytest.approx(1.6)


def test_an_interface_the_runtime_lacks_is_seen_without_losing_the_connection(fake):
    fake.has_input_interface = False
    runtime = OpenVrRuntime.join()
    assert not runtime.vr.isInterfaceVersionValid(openvr.IVRInput_Version)
    assert runtime.vr.isInterfaceVersionValid(openvr.IVRSystem_Version)
    assert not runtime.events().quits
    runtime.close()


def test_the_real_library_without_a_runtime_is_one_sentence(no_registry, capfd):
    with pytest.raises(DeviceError, match="not installed"):
        list_controllers()
    assert capfd.readouterr() == ("", "")  # the library would say so too


def test_the_real_library_says_that_the_runtime_does_not_run(fake):
    fake.running = False
    with pytest.raises(DeviceError, match="not running"):
        list_controllers()
