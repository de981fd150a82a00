"""The matrix of kills, stops and cuts run several times over, and one table of all its runs.

`--times N` runs each test that is marked `matrix` so often. A run is excused if it failed and the
machine stood still meanwhile (see `tests.second_chance`); it is repeated, and both are counted.
"""

from __future__ import annotations

import re
from collections import Counter

import pytest

from tests.second_chance import PROPERTY

MARK = "matrix"
COLUMNS = ("runs", "as expected", "excused", "failed", "skipped")
_TURN = re.compile(r"(-turn\d+|turn\d+-|\[turn\d+\])")


class Matrix:
    """A pytest plugin: repeats, counts, and prints the counts at the end of the run."""

    def __init__(self, times: int | None) -> None:
        """`times`: None if the tests are run once, among others, and need no table."""
        self._times = times
        self._counts: dict[str, Counter[str]] = {}
        self._ended: dict[str, str] = {}  # of the runs that are under way

    def pytest_configure(self, config: pytest.Config) -> None:
        config.addinivalue_line("markers", f"{MARK}: a kill, stop or cut; see --times")

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        if self._times is not None and metafunc.definition.get_closest_marker(MARK):
            if "turn" not in metafunc.fixturenames:
                metafunc.fixturenames.append("turn")
            turns = range(self._times)
            ids = [f"turn{turn}" for turn in turns]
            metafunc.parametrize("turn", turns, indirect=True, scope="module", ids=ids)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if MARK not in report.keywords:
            return
        if report.failed or report.skipped:
            self._ended[report.nodeid] = report.outcome
        if report.when == "teardown":
            ended = self._ended.pop(report.nodeid, "as expected")
            counts = self._counts.setdefault(_TURN.sub("", report.nodeid), Counter())
            excused = sum(name == PROPERTY for name, _ in report.user_properties)
            counts.update({"runs": 1 + excused, "excused": excused, ended: 1})

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if not self._counts or self._times is None:
            return
        terminalreporter.section("kills, stops and cuts with the product's own limits")
        terminalreporter.write_line("  ".join(COLUMNS))
        for test, counts in self._counts.items():
            terminalreporter.write_line(_row(counts, test))
        terminalreporter.write_line(_row(sum(self._counts.values(), Counter()), "in all"))


def _row(counts: Counter[str], test: str) -> str:
    return "  ".join([*(f"{counts[name]:{len(name)}}" for name in COLUMNS), test])
