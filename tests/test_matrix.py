"""Each run of the matrix is counted, however it ended."""

from __future__ import annotations

from pathlib import Path

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
    def start(self):
        pass

    def close(self):
        pass

    def longest(self, windows):
        return Standstill("processor 0", 0, 90_000_000)


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
TESTS = """
from pathlib import Path

import pytest

pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=30)]


def once_more(name):
    file = Path(__file__).with_name(name)
    there = file.exists()
    file.touch()
    return there


@pytest.fixture(scope="module")
def session(turn):
    return turn


@pytest.mark.matrix
@pytest.mark.parametrize("servo", ["velocity", "pose"])
def test_killed(servo):
    pass


@pytest.mark.matrix
def test_excused_in_its_second_turn(turn):
    assert turn != 1 or once_more("excused")


@pytest.mark.matrix
def test_of_one_session_each_turn(session, turn):
    assert session == turn


@pytest.mark.matrix
def test_skipped():
    pytest.skip("measured beforehand")


@pytest.mark.matrix
def test_broken(turn):
    assert turn != 2


def test_of_no_matrix():
    pass
"""


def test_every_run_is_in_the_table_with_how_it_ended(pytester, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent.parent))
    pytester.makeconftest(PLUGIN)
    pytester.makepyfile(TESTS)
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider", "--times", "3")
    lines = result.outlines
    start = lines.index("  ".join(COLUMNS)) + 1
    rows = [line.split(None, 5) for line in lines[start : start + 7]]
    found = {name.split("::")[-1]: [int(one) for one in counts] for *counts, name in rows}
    assert found == {
        "test_killed[velocity]": [3, 3, 0, 0, 0],
        "test_killed[pose]": [3, 3, 0, 0, 0],
        "test_excused_in_its_second_turn": [4, 3, 1, 0, 0],
        "test_of_one_session_each_turn": [3, 3, 0, 0, 0],
        "test_skipped": [3, 0, 0, 0, 3],
        "test_broken": [5, 2, 2, 1, 0],
        "in all": [21, 14, 3, 1, 3],
    }
    assert any("excused" in line and "90 ms" in line for line in lines)


def test_without_the_option_each_is_run_once_and_there_is_no_table(pytester, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent.parent))
    pytester.makeconftest(PLUGIN)
    pytester.makepyfile(TESTS)
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider")
    assert result.parseoutcomes() == {"passed": 6, "skipped": 1}
    assert not any("in all" in line for line in result.outlines)


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
def test_a_row_that_did_not_run_once_fails_a_matrix(pytester, monkeypatch, skipped, code, options):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent.parent))
    pytester.makeconftest(PLUGIN)
    pytester.makepyfile(SKIPPED.replace("{skipped}", str(skipped)))
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider", *options)
    assert result.ret == code
    assert "  ".join(COLUMNS) in result.outlines
    missing = [line for line in result.outlines if line.startswith("not run at all: ")]
    assert len(missing) == skipped
    assert ("more than 2% of the runs were skipped" in result.outlines) == (skipped > 1)


def test_among_other_tests_a_skipped_row_fails_nothing(pytester, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent.parent))
    pytester.makeconftest(PLUGIN)
    pytester.makepyfile(SKIPPED.replace("{skipped}", "60"))
    assert pytester.runpytest_subprocess("-p", "no:cacheprovider").ret == 0
