"""Second chances are limited."""

from pathlib import Path

import pytest

pytest_plugins = ["pytester"]
pytestmark = pytest.mark.waiting

FLAKY = """
from pathlib import Path

import pytest

@pytest.mark.parametrize("number", range({tests}))
def test_that_fails_at_first(number):
    failed = Path(__file__).with_name(f"failed-{{number}}")
    first = not failed.exists()
    failed.touch()
    assert number >= {flaky} or not first
"""
PLUGIN = """
from tests.rerun_budget import RerunBudget

def pytest_configure(config):
    config.pluginmanager.register(RerunBudget())
"""


@pytest.mark.parametrize(
    ("tests", "flaky", "passes", "workers"),
    [
        (10, 1, True, ()),
        (10, 2, False, ()),
        (200, 2, True, ()),
        (200, 3, False, ()),
        (10, 2, False, ("-n", "2")),
    ],
)
def test_a_run_fails_if_more_than_one_percent_needed_a_rerun(
    pytester, monkeypatch, tests, flaky, passes, workers
):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent.parent))
    pytester.makeconftest(PLUGIN)
    pytester.makepyfile(FLAKY.format(tests=tests, flaky=flaky))
    result = pytester.runpytest_subprocess("--reruns=2", "-p", "no:cacheprovider", *workers)
    assert result.ret == (pytest.ExitCode.OK if passes else pytest.ExitCode.TESTS_FAILED)
    assert result.parseoutcomes() == {"passed": tests, "rerun": flaky}
    told = f"FAILED: {flaky} of {tests} tests needed a rerun" in result.stdout.str()
    assert told is not passes
