import importlib
import platform
from pathlib import Path

import openvr
import pytest

from hw.openvr.runtime import OpenVrRuntime, is_registered, load_binding
from tams_app.errors import DeviceError, SetupError

pytestmark = pytest.mark.untimed


@pytest.mark.parametrize(
    ("code", "says"),
    [
        (openvr.VRInitError_Init_PathRegistryNotFound, "not installed"),
        (openvr.VRInitError_Init_HmdNotFound, "no headset"),
        (openvr.VRInitError_Init_ShuttingDown, "not running"),
        (openvr.VRInitError_IPC_ConnectFailed, "IPC_ConnectFailed"),
        (987654, "cannot be reached"),
    ],
)
def test_every_refusal_is_a_device_error_that_says_what_to_do(fake, monkeypatch, code, says):
    monkeypatch.setattr(fake, "init_error", lambda _: code)
    with pytest.raises(DeviceError, match=says):
        OpenVrRuntime.join()


def test_events_end_and_never_hold_the_caller_for_ever(fake):
    runtime = OpenVrRuntime.join()
    fake.events.extend([openvr.VREvent_ButtonPress] * 100)
    runtime.events()
    assert 0 < len(fake.events) < 100
    runtime.events()
    assert not fake.events
    runtime.close()


def test_a_missing_library_is_a_setup_error(monkeypatch):
    def fail(_: str) -> None:
        raise OSError("wrong ELF class")

    monkeypatch.setattr(importlib, "import_module", fail)
    with pytest.raises(SetupError, match="wrong ELF class"):
        load_binding()


def test_the_registry_is_looked_for_where_the_library_does(monkeypatch, tmp_path):
    monkeypatch.setattr(platform, "system", lambda: "Linux")
    monkeypatch.delenv("VR_PATHREG_OVERRIDE", raising=False)
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    assert not is_registered()
    registry = tmp_path / ".config" / "openvr" / "openvrpaths.vrpath"
    registry.parent.mkdir(parents=True)
    registry.touch()
    assert is_registered()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "elsewhere"))
    assert not is_registered()
    monkeypatch.setenv("VR_PATHREG_OVERRIDE", str(registry))
    assert is_registered()
    monkeypatch.setenv("VR_PATHREG_OVERRIDE", str(tmp_path))
    assert not is_registered()


def test_where_the_registry_is_elsewhere_the_library_is_asked(monkeypatch, tmp_path):
    monkeypatch.setattr(platform, "system", lambda: "Windows")
    monkeypatch.setenv("VR_PATHREG_OVERRIDE", str(tmp_path / "none"))
    assert is_registered()
