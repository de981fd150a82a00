"""The benches of the arm's fault matrix: in which servo, and over what.

They are imported where they are made: the other half of the matrix needs no driver.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.faults.bench import Bench
    from tests.faults.virtual_bench import VirtualBench
    from tests.faults.wired_bench import MakeBench, WiredBench


@pytest.fixture
def frequent_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every report at 100 Hz: setting up waits for the 5 Hz one several times."""
    from hw.sim.controller.reports import ReportKind

    monkeypatch.setattr(ReportKind, "rate_hz", property(lambda _: 100))


@pytest.fixture(params=["velocity", "pose"])
def virtual_bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[VirtualBench]:
    """Virtual time, in each servo, with a log."""
    from tests.faults.virtual_bench import VirtualBench

    bench = VirtualBench(request.param, tmp_path)
    yield bench
    bench.close()


@pytest.fixture
def make_bench(frequent_reports: None) -> Iterator[MakeBench]:
    """Benches over the wire with what the test asks for, closed at its end."""
    from tests.faults.wired_bench import WiredBench

    with ExitStack() as stack:

        def make(servo: str = "velocity", **others: object) -> WiredBench:
            bench = WiredBench(servo, **others)  # type: ignore[arg-type]
            stack.callback(bench.close)
            return bench

        yield make


@pytest.fixture(params=["velocity", "pose"])
def wired_bench(
    request: pytest.FixtureRequest, tmp_path: Path, make_bench: MakeBench
) -> WiredBench:
    """The driver over TCP, in each servo, with a log."""
    return make_bench(request.param, folder=tmp_path)


@pytest.fixture(params=["wired velocity", "wired pose", "virtual velocity", "virtual pose"])
def any_bench(
    request: pytest.FixtureRequest, tmp_path: Path, make_bench: MakeBench
) -> Iterator[Bench]:
    """The driver over TCP and the in-process arm in virtual time, in each servo, with a log."""
    yield from _bench(request.param, tmp_path, make_bench)


@pytest.fixture(params=["wired velocity", "virtual pose"])
def either_bench(
    request: pytest.FixtureRequest, tmp_path: Path, make_bench: MakeBench
) -> Iterator[Bench]:
    """Each arm once: for what has nothing to do with the servo."""
    yield from _bench(request.param, tmp_path, make_bench)


def _bench(what: str, folder: Path, make_bench: MakeBench) -> Iterator[Bench]:
    from tests.faults.virtual_bench import VirtualBench

    kind, servo = what.split()
    if kind == "wired":
        yield make_bench(servo, folder=folder)
        return
    bench = VirtualBench(servo, folder)
    yield bench
    bench.close()
