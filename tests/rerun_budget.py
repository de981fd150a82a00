"""A limit to second chances: a run fails if too many of its tests needed one."""

from __future__ import annotations

import pytest

SHARE = 0.01  # of the tests of a run; one test is always allowed


class RerunBudget:
    """A pytest plugin that counts the tests which `--reruns` had to repeat.

    With pytest-xdist the main process sees the reports of every worker, and decides.
    """

    def __init__(self) -> None:
        self._ran: set[str] = set()
        self._repeated: set[str] = set()

    @property
    def exceeded(self) -> bool:
        return len(self._repeated) > max(1, SHARE * len(self._ran))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._ran.add(report.nodeid)
        if report.outcome == "rerun":
            self._repeated.add(report.nodeid)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.exceeded and not hasattr(session.config, "workerinput"):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self.exceeded:
            terminalreporter.write_line(
                f"FAILED: {len(self._repeated)} of {len(self._ran)} tests needed a rerun, "
                f"more than {SHARE:.0%}",
                red=True,
            )
