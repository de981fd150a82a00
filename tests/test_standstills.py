"""What counts as a standstill of the machine, and what the tests' own processes cannot make one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import psutil
import pytest

from tests.standstills import Standstills, is_one

pytestmark = pytest.mark.timed

STOPPED_S = 0.3
# As a control loop with a defect: it computes without a pause, above the ordinary.
SPINNING = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
except PermissionError:
    pass
end = time.monotonic() + 1.5
while time.monotonic() < end:
    pass
"""


@pytest.fixture
def standstills() -> Iterator[Standstills]:
    made = Standstills()
    yield made
    made.close()


@pytest.fixture
def probes(standstills: Standstills) -> list[psutil.Process]:
    """The processes of `standstills`, started; the run of the tests has probes of its own."""
    before = psutil.Process().children()
    standstills.start()
    return [child for child in psutil.Process().children() if child not in before]


@pytest.mark.usefixtures("probes")
def test_a_machine_that_runs_has_no_long_standstill(standstills: Standstills) -> None:
    began_ns = time.monotonic_ns()
    time.sleep(0.5)
    found = standstills.longest([(began_ns, time.monotonic_ns())])
    assert found is None or found.ms < 1000 * STOPPED_S / 2


@pytest.mark.parametrize(
    ("gap_ms", "worked_ms", "counts"),
    [(150.0, 0.0, True), (150.0, 20.0, True), (150.0, 140.0, False), (19.0, 0.0, False)],
)
def test_a_processor_that_worked_did_not_stand_still(
    gap_ms: float, worked_ms: float, counts: bool
) -> None:
    assert is_one(gap_ms, worked_ms) is counts


def test_a_probe_that_did_not_run_tells_so(
    standstills: Standstills, probes: list[psutil.Process]
) -> None:
    (probe,) = (child for child in probes if child.cmdline()[-1:] == ["ordinary"])
    began_ns = time.monotonic_ns()
    probe.send_signal(signal.SIGSTOP)
    time.sleep(STOPPED_S)
    probe.send_signal(signal.SIGCONT)
    time.sleep(0.1)
    found = standstills.longest([(began_ns, time.monotonic_ns())])
    assert found is not None
    assert found.ms > 1000 * STOPPED_S - 50
    before = standstills.longest([(began_ns - 10**9, began_ns)])
    assert before is None or before.ms < 1000 * STOPPED_S / 2, "only what lies in the window"
    half = standstills.longest([(began_ns, began_ns + round(STOPPED_S / 2 * 1e9))])
    assert half is not None
    assert half.ms <= 1000 * STOPPED_S / 2


@pytest.mark.usefixtures("probes")
@pytest.mark.parametrize("processor", sorted(os.sched_getaffinity(0))[:2])
def test_a_loop_that_computes_without_a_pause_is_no_standstill(
    standstills: Standstills, processor: int
) -> None:
    began_ns = time.monotonic_ns()
    subprocess.run([sys.executable, "-c", SPINNING, str(processor)], check=True, timeout=60)
    found = standstills.longest([(began_ns, time.monotonic_ns())])
    # the scheduler may take a moment until what waited there runs on another processor
    assert found is None or found.ms < 150.0, "a tenth of the time that the loop computes"


def test_the_probes_end_with_whom_they_serve(
    standstills: Standstills, probes: list[psutil.Process]
) -> None:
    assert len(probes) == 2
    standstills.close()
    _, alive = psutil.wait_procs(probes, timeout=10)
    assert alive == []
