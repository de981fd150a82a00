"""The bottleneck between two network namespaces, and that nothing of it stays behind."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from benchmarks.uplink import tbf
from tams_app.errors import SetupError

pytestmark = pytest.mark.waiting

KBPS = 3000.0


@pytest.fixture
def permitted() -> None:
    """Skips, before anything is measured, where this machine lacks something."""
    try:
        with tbf.namespaces(KBPS):
            pass
    except SetupError as error:
        pytest.skip(str(error))


def spaces() -> set[str]:
    found = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True)
    return {line.split()[0] for line in found.stdout.splitlines() if line.startswith("tams-")}


@pytest.mark.usefixtures("permitted")
def test_a_session_s_senders_find_a_bottleneck_that_nobody_told_them_of() -> None:
    before = spaces()
    found = tbf.run(KBPS, 3.0, 4.0)
    # without a budget they would ask for 20 Mbit/s, at the floors for a sixth of this
    assert 0.2 < found["utilisation"] < 1.05
    assert 0.0 <= found["dropped_fraction"] < 1.0
    assert 0.0 <= found["queue_ms"]["p50"] <= found["queue_ms"]["p95"] <= found["queue_ms"]["max"]
    assert spaces() == before


@pytest.mark.usefixtures("permitted")
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_is_broken_off_leaves_no_namespace(ending: int) -> None:
    before = spaces()
    run = subprocess.Popen([sys.executable, "-m", "benchmarks.uplink.tbf"], stderr=subprocess.PIPE)
    deadline = time.monotonic() + 30
    while len(spaces()) < len(before) + 2 and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(2)
    run.send_signal(ending)
    run.communicate(timeout=30)
    assert spaces() == before


def test_what_a_machine_lacks_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tbf.os, "geteuid", lambda: 1000)
    with pytest.raises(SetupError, match="need Linux and root"), tbf.namespaces(KBPS):
        pass
