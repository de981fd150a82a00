"""A second chance needs a measured cause, is counted and printed, and few tests get one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.further import further

pytest_plugins = ["pytester"]
pytestmark = pytest.mark.waiting

PLUGIN = """
import json
from pathlib import Path

from tests.second_chance import SecondChances
from tests.standstills import Standstill


class Measured:
    '''Whatever the test was, that is how long the machine stood still.'''

    def start(self):
        pass

    def close(self):
        pass

    def longest(self, windows):
        ms = json.loads(Path(__file__).with_name("standstill.json").read_text())
        return ms and Standstill("processor 1", 0, ms * 1_000_000)


def pytest_configure(config):
    for group in ("waiting", "timed", "untimed"):
        config.addinivalue_line("markers", group)
    config.pluginmanager.register(SecondChances(Measured()))
"""
FLAKY = """
from pathlib import Path

import pytest

pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=50)]


def times(name):
    file = Path(__file__).with_name(f"ran-{{name}}")
    file.write_text(file.read_text() + "x" if file.exists() else "x")
    return len(file.read_text())


@pytest.mark.parametrize("number", range({tests}))
def test_that_fails_at_first(number):
    assert number >= {flaky} or times(number) > {failures}
"""


@pytest.fixture
def run(pytester, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent.parent))

    def run(body, standstill_ms, *words):
        pytester.makeconftest(PLUGIN)
        (pytester.path / "standstill.json").write_text(json.dumps(standstill_ms))
        pytester.makepyfile(body)
        return pytester.runpytest_subprocess("-p", "no:cacheprovider", *words)

    return run


def ran(pytester, name):
    return len((pytester.path / f"ran-{name}").read_text())


def test_a_test_that_fails_without_a_measured_standstill_fails_at_once(run, pytester):
    for standstill_ms in (None, 49.9):
        result = run(FLAKY.format(tests=1, flaky=1, failures=9), standstill_ms)
        assert result.parseoutcomes() == {"failed": 1}
        assert ran(pytester, 0) == 1
        (pytester.path / "ran-0").unlink()


def test_one_with_a_standstill_is_repeated_and_printed_with_its_cause(run):
    result = run(FLAKY.format(tests=1, flaky=1, failures=1), 143)
    assert result.ret == pytest.ExitCode.OK
    assert result.parseoutcomes() == {"passed": 1}
    (line,) = (line for line in result.outlines if "stood still" in line)
    assert "test_that_fails_at_first[0]: processor 1 stood still for 143 ms" in line
    assert "more than 50 ms; its call had failed: assert" in line


def test_whatever_the_machine_does_a_test_that_fails_three_times_fails(run, pytester):
    result = run(FLAKY.format(tests=1, flaky=1, failures=9), 143)
    assert result.parseoutcomes() == {"failed": 1}
    assert ran(pytester, 0) == 3


def test_one_that_is_not_marked_gets_no_second_chance(run, pytester):
    body = FLAKY.format(tests=1, flaky=1, failures=9)
    result = run(body.replace(", pytest.mark.second_chance(standstill_ms=50)", ""), 143)
    assert result.parseoutcomes() == {"failed": 1}
    assert ran(pytester, 0) == 1


def test_one_that_has_failed_does_not_end_as_skipped(run):
    body = (
        FLAKY.format(tests=1, flaky=1, failures=1)
        + """

@pytest.fixture(autouse=True)
def busy():
    if times("fixture") > 1:
        pytest.skip("measured beforehand: this machine is busy")
"""
    )
    assert run(body, 143).parseoutcomes() == {"failed": 1}


def test_what_several_tests_share_is_made_anew_for_a_second_chance(run, pytester):
    body = (
        FLAKY.format(tests=0, flaky=0, failures=0)
        + """

@pytest.fixture(scope="module")
def session():
    return times("session")


def test_of_the_session(session):
    assert session > 1


def test_another_of_it(session):
    assert session > 1
"""
    )
    result = run(body, 143)
    assert result.parseoutcomes() == {"passed": 2, "skipped": 1}
    assert ran(pytester, "session") == 2


@pytest.mark.parametrize(
    ("tests", "flaky", "passes", "workers"),
    [
        (10, 1, True, ()),
        (10, 2, False, ("-n", "2")),
        *further(
            (10, 2, False, ()),
            (200, 2, True, ()),
            (200, 3, False, ()),
            (10, 1, True, ("-n", "2")),
        ),
    ],
)
def test_a_run_fails_if_more_than_one_percent_needed_one(run, tests, flaky, passes, workers):
    result = run(FLAKY.format(tests=tests, flaky=flaky, failures=1), 143, *workers)
    assert result.ret == (pytest.ExitCode.OK if passes else pytest.ExitCode.TESTS_FAILED)
    assert result.parseoutcomes() == {"passed": tests}
    told = [line for line in result.outlines if "stood still for 143 ms" in line]
    assert len(told) == flaky
    sentence = f"FAILED: {flaky} of {tests} tests that keep time needed a second chance"
    assert (sentence in result.stdout.str()) is not passes


def test_tests_that_keep_no_time_do_not_make_room_for_more(run):
    body = (
        FLAKY.format(tests=10, flaky=2, failures=1)
        + """

@pytest.mark.parametrize("number", range(300))
def test_that_computes(number):
    pass
"""
    )
    body = body.replace("[pytest.mark.timed, ", "[").replace(
        '@pytest.mark.parametrize("number", range(10))',
        '@pytest.mark.timed\n@pytest.mark.parametrize("number", range(10))',
    )
    result = run(body, 143)
    assert result.parseoutcomes() == {"passed": 310}
    assert result.ret == pytest.ExitCode.TESTS_FAILED
