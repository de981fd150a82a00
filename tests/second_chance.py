"""Second chances, for a measured cause only, and counted.

A test marked `second_chance(standstill_ms=...)` that fails is run once more, at most twice, if the
machine stood still during it for longer than that; see `tests.standstills` for how that is
measured. Without such a standstill it fails at once. Each second chance is printed at the end of
the run, and the run fails if more than 1 % of its tests that keep time needed one.
"""

from __future__ import annotations

from collections.abc import Iterator
from time import monotonic_ns

import pytest
from _pytest.runner import call_and_report

from tests.standstills import Standstill, Standstills, Window

MOST = 2  # of one test
SHARE = 0.01  # of a run's waiting and timed tests; one test is always allowed
PROPERTY = "second chance"
MARK = "second_chance"


class SecondChances:
    """A pytest plugin; with pytest-xdist the workers repeat, and the main process counts."""

    def __init__(self, standstills: Standstills) -> None:
        self._standstills = standstills
        self._shared: dict[int, Window] = {}  # when a fixture of several tests was set up
        self._ran: set[str] = set()
        self._needed: dict[str, list[str]] = {}

    def pytest_configure(self, config: pytest.Config) -> None:
        config.addinivalue_line(
            "markers", f"{MARK}(standstill_ms): repeated if the machine stood still for longer"
        )

    # --- running --------------------------------------------------------------------------------

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(
        self, item: pytest.Item, nextitem: pytest.Item | None
    ) -> bool | None:
        mark = item.get_closest_marker(MARK)
        if mark is None:
            return None
        bound_ms = float(mark.kwargs["standstill_ms"])
        self._standstills.start()
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        failed: list[pytest.TestReport] = []
        for left in range(MOST, -1, -1):
            reports, again = self._attempt(item, nextitem, bound_ms if left else None)
            if failed and any(report.skipped for report in reports):
                reports = failed  # a test that has failed does not end as skipped
            if not again:
                break
            failed = reports
        for report in reports:
            report.user_properties = list(item.user_properties)
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def _attempt(
        self, item: pytest.Item, nextitem: pytest.Item | None, bound_ms: float | None
    ) -> tuple[list[pytest.TestReport], bool]:
        """Run the test once; its reports, and whether it gets a second chance.

        It gets none without `bound_ms`. One that does is torn down with all that it shares.
        """
        began_ns = monotonic_ns()
        item._initrequest()  # type: ignore[attr-defined]
        reports = [call_and_report(item, "setup", log=False)]
        if reports[-1].passed:
            reports.append(call_and_report(item, "call", log=False))
        again = self._is_excused(item, reports, began_ns, bound_ms)
        whole = again or item.session.shouldfail or item.session.shouldstop
        next_one = None if whole else nextitem
        reports.append(call_and_report(item, "teardown", log=False, nextitem=next_one))
        again = again or self._is_excused(item, reports[-1:], began_ns, bound_ms)
        item._request = False  # type: ignore[attr-defined]
        item.funcargs = None  # type: ignore[attr-defined]
        return reports, again

    def _is_excused(
        self,
        item: pytest.Item,
        reports: list[pytest.TestReport],
        began_ns: int,
        bound_ms: float | None,
    ) -> bool:
        broken = next((report for report in reports if report.failed), None)
        if broken is None or bound_ms is None:
            return False
        windows = [*self._windows_of_shared(item), (began_ns, monotonic_ns())]
        longest = self._standstills.longest(windows)
        if longest is None or longest.ms <= bound_ms:
            return False
        item.user_properties.append((PROPERTY, _told(longest, bound_ms, broken)))
        return True

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef[object], request: pytest.FixtureRequest
    ) -> Iterator[None]:
        began_ns = monotonic_ns()
        try:
            return (yield)  # type: ignore[misc]
        finally:
            if fixturedef.scope != "function":
                self._shared[id(fixturedef)] = began_ns, monotonic_ns()

    def _windows_of_shared(self, item: pytest.Item) -> list[Window]:
        """When the fixtures that this test shares with others were set up."""
        found = item._fixtureinfo.name2fixturedefs  # type: ignore[attr-defined]
        ids = [id(one) for each in found.values() for one in each]
        return [self._shared[one] for one in ids if one in self._shared]

    # --- counting -------------------------------------------------------------------------------

    @property
    def exceeded(self) -> bool:
        return len(self._needed) > max(1, SHARE * len(self._ran))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if "waiting" in report.keywords or "timed" in report.keywords:
            self._ran.add(report.nodeid)
        if told := [str(what) for name, what in report.user_properties if name == PROPERTY]:
            self._needed[report.nodeid] = told

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.exceeded and not hasattr(session.config, "workerinput"):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self._needed:
            terminalreporter.section("second chances")
        for test, told in self._needed.items():
            for one in told:
                terminalreporter.write_line(f"{test}: {one}")
        if self.exceeded:
            terminalreporter.write_line(
                f"FAILED: {len(self._needed)} of {len(self._ran)} tests that keep time needed a "
                f"second chance, more than {SHARE:.0%}",
                red=True,
            )

    def pytest_unconfigure(self) -> None:
        self._standstills.close()


def _told(longest: Standstill, bound_ms: float, broken: pytest.TestReport) -> str:
    crash = getattr(broken.longrepr, "reprcrash", None)
    why = crash.message if crash is not None else broken.longreprtext
    first = next(iter(why.splitlines()), "")
    return (
        f"{longest.what} stood still for {longest.ms:.0f} ms, more than {bound_ms:g} ms; "
        f"its {broken.when} had failed: {first}"
    )
