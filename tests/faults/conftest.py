"""The benches of the arm's fault matrix: what is driven, and over what.

They are imported where they are made: the other half of the matrix needs no driver.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from .arm_bench import ArmBench, LiveBench, MakeBench


@pytest.fixture
def frequent_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every report at 100 Hz: setting up waits for the 5 Hz one several times."""
    from hw.sim.controller_reports import ReportKind

    monkeypatch.setattr(ReportKind, "rate_hz", property(lambda _: 100))


@pytest.fixture
def make_bench(frequent_reports: None) -> Iterator[MakeBench]:
    """Live benches with what the test asks for, closed at its end."""
    from .arm_bench import LiveBench
    from .bench import configuration

    with ExitStack() as stack:

        def make(servo: str = "velocity", **others: object) -> LiveBench:
            bench = LiveBench(configuration(servo), **others)  # type: ignore[arg-type]
            stack.callback(bench.close)
            return bench

        yield make


@pytest.fixture(params=["velocity", "pose"])
def live_bench(request: pytest.FixtureRequest, tmp_path: Path, make_bench: MakeBench) -> LiveBench:
    """The driver over TCP, in each servo, with a log."""
    return make_bench(request.param, folder=tmp_path)


@pytest.fixture(params=["live velocity", "live pose", "virtual velocity", "virtual pose"])
def arm_bench(
    request: pytest.FixtureRequest, tmp_path: Path, make_bench: MakeBench
) -> Iterator[ArmBench]:
    """The driver over TCP and the in-process arm in virtual time, in each servo, with a log."""
    yield from _bench(request.param, tmp_path, make_bench)


@pytest.fixture(params=["live velocity", "virtual pose"])
def either_bench(
    request: pytest.FixtureRequest, tmp_path: Path, make_bench: MakeBench
) -> Iterator[ArmBench]:
    """Each arm once: for what has nothing to do with the servo."""
    yield from _bench(request.param, tmp_path, make_bench)


def _bench(what: str, folder: Path, make_bench: MakeBench) -> Iterator[ArmBench]:
    from .arm_bench import VirtualBench
    from .bench import configuration

    kind, servo = what.split()
    if kind == "live":
        yield make_bench(servo, folder=folder)
        return
    bench = VirtualBench(configuration(servo), folder)
    yield bench
    bench.close()
