"""A test gets a second chance for a measured cause only, and each run of the matrix is counted."""

from __future__ import annotations

import pytest

from tests.matrix import COLUMNS

pytest_plugins = ["pytester"]
pytestmark = pytest.mark.waiting

PLUGIN = """
import pytest

from tests.matrix import Matrix
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


@pytest.fixture(scope="module")
def turn(request):
    return getattr(request, "param", 0)


def pytest_addoption(parser):
    parser.addoption("--times", type=int)


def pytest_configure(config):
    config.addinivalue_line("markers", "timed")
    config.pluginmanager.register(SecondChances(Measured()))
    config.pluginmanager.register(Matrix(config.getoption("--times")))
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


SKIPS_THEN = """

@pytest.fixture(autouse=True)
def busy():
    if Path(__file__).with_name("ran").exists():
        pytest.skip("measured beforehand: this machine is busy")
"""


@pytest.fixture
def run(pytester):
    def run(body, standstill_ms, *options):
        pytester.makeconftest(PLUGIN.format(ms=standstill_ms))
        pytester.makepyfile(body)
        # the time limit of this test is none of theirs
        return pytester.runpytest_inprocess("-p", "no:cacheprovider", "-p", "no:timeout", *options)

    return run


@pytest.mark.parametrize(("standstill_ms", "times"), [(None, 1), (49.9, 1), (143, 3)])
def test_a_test_that_fails_is_repeated_only_after_a_standstill_and_at_most_twice(
    run, pytester, standstill_ms, times
):
    assert run(FAILS, standstill_ms).parseoutcomes() == {"failed": 1}
    assert (pytester.path / "ran").read_text() == "x" * times


def test_one_that_has_failed_does_not_end_as_skipped(run):
    assert run(FAILS + SKIPS_THEN, 143).parseoutcomes() == {"failed": 1}


SKIPPED = """
import pytest

pytestmark = [pytest.mark.timed, pytest.mark.matrix]


@pytest.mark.parametrize("number", range(60))
def test_killed(number):
    if number < {skipped}:
        pytest.skip("measured beforehand")


@pytest.mark.parametrize("number", range(3))
def test_cut(number):
    pass
"""


@pytest.mark.parametrize("options", [("-m", "matrix"), ("--times", "2")])
@pytest.mark.parametrize(("skipped", "code"), [(0, 0), (1, 1), (60, 1)])
def test_a_row_that_did_not_run_once_fails_a_matrix(run, skipped, code, options):
    result = run(SKIPPED.replace("{skipped}", str(skipped)), 90, *options)
    assert result.ret == code
    assert "  ".join(COLUMNS) in result.outlines
    missing = [line for line in result.outlines if line.startswith("not run at all: ")]
    assert len(missing) == skipped
    assert ("more than 2% of the runs were skipped" in result.outlines) == (skipped > 1)
