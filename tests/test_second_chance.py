"""A second chance needs a measured cause, is counted and printed, and few tests get one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

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


def test_whatever_the_machine_does_a_test_that_fails_three_times_fails(run, pytester):
    result = run(FLAKY.format(tests=1, flaky=1, failures=9), 143)
    assert result.parseoutcomes() == {"failed": 1}
    assert ran(pytester, 0) == 3


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
