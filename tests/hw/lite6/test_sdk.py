"""The SDK as it is loaded here: quiet and without traces."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hw.lite6.sdk import FACTORY_CONTROL_PORT, connect_sdk, disconnect_sdk
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


def test_a_port_other_than_the_factorys_is_put_back_at_once() -> None:
    with controller() as rig:
        api = connect_sdk("localhost", rig.config().control_port)
        from xarm.core.config.x_config import XCONF

        assert api.connected
        assert XCONF.SocketConf.TCP_CONTROL_PORT == FACTORY_CONTROL_PORT
        disconnect_sdk(api)
        assert not api.connected
