"""A test gets a second chance for a measured cause only."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest_plugins = ["pytester"]
pytestmark = pytest.mark.waiting

PLUGIN = """
from tests.second_chance import SecondChances
from tests.standstills import Standstill


class Measured:
    '''Whatever the test was, that is how long the machine stood still.'''

    def start(self):
        pass

    def close(self):
        pass

    def longest(self, windows):
        return {ms} and Standstill("processor 1", 0, {ms} * 1_000_000)


def pytest_configure(config):
    config.addinivalue_line("markers", "timed")
    config.pluginmanager.register(SecondChances(Measured()))
"""
FAILS = """
from pathlib import Path

import pytest


@pytest.mark.timed
@pytest.mark.second_chance(standstill_ms=50)
def test_that_fails():
    with Path(__file__).with_name("ran").open("a") as file:
        file.write("x")
    raise AssertionError
"""


@pytest.mark.parametrize(("standstill_ms", "times"), [(None, 1), (49.9, 1), (143, 3)])
def test_a_test_that_fails_is_repeated_only_after_a_standstill_and_at_most_twice(
    pytester, monkeypatch, standstill_ms, times
):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent.parent))
    pytester.makeconftest(PLUGIN.format(ms=standstill_ms))
    pytester.makepyfile(FAILS)
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider")
    assert result.parseoutcomes() == {"failed": 1}
    assert (pytester.path / "ran").read_text() == "x" * times
