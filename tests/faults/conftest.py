"""The benches of the arm's fault matrix: over what.

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
    from hw.sim.controller.model import ReportKind

    monkeypatch.setattr(ReportKind, "rate_hz", property(lambda _: 100))


@pytest.fixture
def virtual_bench(tmp_path: Path) -> Iterator[VirtualBench]:
    """Virtual time, with a log."""
    from tests.faults.virtual_bench import VirtualBench

    bench = VirtualBench(tmp_path)
    yield bench
    bench.close()


@pytest.fixture
def make_bench(frequent_reports: None) -> Iterator[MakeBench]:
    """Benches over the wire with what the test asks for, closed at its end."""
    from tests.faults.wired_bench import WiredBench

    with ExitStack() as stack:

        def make(folder: Path | None = None) -> WiredBench:
            bench = WiredBench(folder)
            stack.callback(bench.close)
            return bench

        yield make


@pytest.fixture
def wired_bench(tmp_path: Path, make_bench: MakeBench) -> WiredBench:
    """The driver over TCP, with a log."""
    return make_bench(tmp_path)


@pytest.fixture(params=["wired", "virtual"])
def bench(request: pytest.FixtureRequest, tmp_path: Path, make_bench: MakeBench) -> Iterator[Bench]:
    """The driver over TCP and the in-process arm in virtual time, with a log."""
    from tests.faults.virtual_bench import VirtualBench

    if request.param == "wired":
        yield make_bench(tmp_path)
        return
    bench = VirtualBench(tmp_path)
    yield bench
    bench.close()
