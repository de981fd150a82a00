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
