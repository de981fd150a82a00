"""The matrix of kills, stops and cuts run several times over, and one table of all its runs.

`--times N` runs each test that is marked `matrix` so often. A run is excused if it failed and the
machine stood still meanwhile (see `tests.second_chance`); it is repeated, and both are counted. The
matrix (`-m matrix`, `--times`) fails if too much of it was skipped, or a row was not run.
"""

from __future__ import annotations

import re
from collections import Counter

import pytest

from tests.second_chance import PROPERTY

MARK = "matrix"
MOST_SKIPPED = 0.02
COLUMNS = ("runs", "as expected", "excused", "failed", "skipped")
_TURN = re.compile(r"(-turn\d+|turn\d+-|\[turn\d+\])")


class Matrix:
    """A pytest plugin: repeats, counts, and prints the counts at the end of the run."""

    def __init__(self, times: int | None) -> None:
        """`times`: None if the tests are run once, among others, and need no table."""
        self._times = times
        self._counts: dict[str, Counter[str]] = {}
        self._ended: dict[str, str] = {}  # of the runs that are under way
        self._is_run = times is not None

    def pytest_configure(self, config: pytest.Config) -> None:
        config.addinivalue_line("markers", f"{MARK}: a kill, stop or cut; see --times")
        self._is_run |= config.option.markexpr == MARK

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
        if not self._counts or not self._is_run:
            return
        terminalreporter.section("kills, stops and cuts with the product's own limits")
        terminalreporter.write_line("  ".join(COLUMNS))
        for test, counts in self._counts.items():
            terminalreporter.write_line(_row(counts, test))
        terminalreporter.write_line(_row(self._in_all, "in all"))
        for sentence in self._missing():
            terminalreporter.write_line(sentence, red=True)

    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        if self._is_run and self._missing() and exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    @property
    def _in_all(self) -> Counter[str]:
        return sum(self._counts.values(), Counter())

    def _missing(self) -> list[str]:
        """What has to be run once more, as it proves nothing."""
        counts = self._in_all
        missing = [f"not run at all: {test}" for test, one in self._counts.items() if not _ran(one)]
        if counts["skipped"] > MOST_SKIPPED * counts["runs"]:
            missing.append(f"more than {MOST_SKIPPED:.0%} of the runs were skipped")
        return missing


def _ran(counts: Counter[str]) -> int:
    return counts["runs"] - counts["skipped"]


def _row(counts: Counter[str], test: str) -> str:
    return "  ".join([*(f"{counts[name]:{len(name)}}" for name in COLUMNS), test])
