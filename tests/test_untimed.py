"""What may run beside other tests depends on nothing that the machine does at its own pace."""

from __future__ import annotations

import pytest

from .untimed import PATIENT, TESTS, TIMED_AMONG_THEM, UNTIMED, is_untimed, keeps_time


@pytest.mark.parametrize("pattern", [*UNTIMED, *TIMED_AMONG_THEM, *PATIENT])
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


def test_a_module_is_timed_until_it_is_named() -> None:
    assert is_untimed(TESTS / "policy" / "test_phases.py")
    assert is_untimed(TESTS / "study" / "test_cli.py"), "it waits for what it started"
    assert not is_untimed(TESTS / "test_end_to_end.py")
    assert not is_untimed(TESTS / "hw" / "sim" / "test_controller_server.py"), "it has sockets"
