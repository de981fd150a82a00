"""What may run beside other tests depends on nothing that the machine does at its own pace."""

from __future__ import annotations

import pytest

from .pace import PATIENT, TESTS, TIMED, UNTIMED, Pace, keeps_time, pace_of


@pytest.mark.parametrize("pattern", [*UNTIMED, *PATIENT, *TIMED])
def test_every_pattern_names_a_test(pattern: str) -> None:
    assert any(TESTS.glob(pattern))


@pytest.mark.parametrize(
    "source",
    [
        "import socket\n",
        "def start():\n    from threading import Thread\n",
        "import time\n\ntime.sleep(1)\n",
        "began_s = time.monotonic()\n",
        "from tams_app.clock import MonotonicClock\n",
        "from .wired_bench import WiredBench\n",
    ],
)
def test_a_module_that_speaks_of_process_socket_thread_or_clock_keeps_time(source: str) -> None:
    assert keeps_time(source)


def test_virtual_time_is_none_of_the_machines() -> None:
    assert not keeps_time("from tams_app.clock import VirtualClock\nsocketed = sleeping = 1\n")


@pytest.mark.parametrize(
    ("name", "pace"),
    [
        ("policy/test_phases.py", Pace.UNTIMED),
        ("study/test_cli.py", Pace.UNTIMED),  # it waits for what it started
        ("hw/test_openvr_tracking.py", Pace.UNTIMED),
        ("hw/sim/test_controller_server.py", Pace.WAITING),  # it has sockets
        ("contract/test_arm.py", Pace.WAITING),
        ("hw/sim/test_renderer.py", Pace.WAITING),  # a process of its own
        ("test_end_to_end.py", Pace.TIMED),
    ],
)
def test_a_module_keeps_time_until_it_is_named(name: str, pace: Pace) -> None:
    assert pace_of(TESTS / name) is pace
