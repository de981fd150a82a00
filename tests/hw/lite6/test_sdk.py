"""The SDK as it is loaded here: quiet and without traces."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hw.lite6.codes import NOTHING_GETS_THROUGH, Code, Mode
from hw.lite6.sdk import (
    connect_sdk,
    disconnect_sdk,
    note_mode,
    set_cartesian_velocity,
)
from tests.hw.lite6.controller_rig import controller

pytestmark = pytest.mark.waiting

LOAD = """
import os, sys
before = dict(os.environ)
from hw.lite6.sdk import _load
_load()
assert dict(os.environ) == before
print("loaded", "xarm" in sys.modules)
"""


def load_with_home(home: str, directory: Path) -> str:
    environment = {**os.environ, "HOME": home, "TMPDIR": str(directory)}
    loaded = subprocess.run(
        [sys.executable, "-W", "error", "-c", LOAD],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert loaded.stderr == ""
    return loaded.stdout


def test_loading_prints_nothing_and_leaves_no_folder_in_the_home(tmp_path: Path) -> None:
    home, temporary = tmp_path / "home", tmp_path / "temporary"
    home.mkdir()
    temporary.mkdir()
    assert load_with_home(str(home), temporary) == "loaded True\n"
    assert list(home.iterdir()) == []
    assert list(temporary.iterdir()) == []


def test_it_loads_where_the_home_cannot_be_written_or_is_empty(tmp_path: Path) -> None:
    for home in ("/proc/no-such-home", ""):
        assert load_with_home(home, tmp_path) == "loaded True\n"


def test_the_sdks_own_port_is_put_back_at_once() -> None:
    with controller() as rig:
        api = connect_sdk("localhost", rig.config().control_port)
        from xarm.core.comm import SocketPort
        from xarm.x3 import base

        assert api.connected
        assert base.SocketPort is SocketPort
        disconnect_sdk(api)
        assert not api.connected


def test_a_velocity_is_sent_and_answered_as_by_the_sdks_own_call() -> None:
    speeds, duration_s = [12.5, -3.0, 0.25, 0.1, -0.2, 0.3], 0.1
    with controller() as rig:
        api = connect_sdk("localhost", rig.config().control_port)
        port = api._arm.arm_cmd.arm_port
        frames: list[bytes] = []
        write = port.write
        port.write = lambda frame: (frames.append(frame), write(frame))[1]

        def both() -> list[int]:
            frames.clear()
            theirs = api.vc_set_cartesian_velocity(speeds, is_radian=True, duration=duration_s)
            return [theirs, set_cartesian_velocity(api, speeds, duration_s)]

        assert both() == [Code.INVALID] * 2  # the mode is another
        api.motion_enable(True)
        api.set_mode(Mode.CARTESIAN_VELOCITY)
        note_mode(api, Mode.CARTESIAN_VELOCITY)
        assert both() == [Code.NOT_READY] * 2
        api.set_state(0)
        assert both() == [Code.OK] * 2
        read, late = port.read, [b"\0\0\0\2\0\2\x52\0"]  # the reply to an earlier command
        port.read = lambda timeout: late.pop() if late else read(timeout)
        assert set_cartesian_velocity(api, speeds, duration_s) == Code.OK
        assert not late
        port.read = lambda timeout: -1
        assert set_cartesian_velocity(api, speeds, duration_s) == Code.TIMEOUT
        port.read = read
        theirs, ours = frames[:2]
        assert ours[2:] == theirs[2:]  # all but the number of the transaction
        assert int.from_bytes(ours[:2]) == int.from_bytes(theirs[:2]) + 1
        port.close()
        assert set(both()) <= NOTHING_GETS_THROUGH
        disconnect_sdk(api)
