import pytest

from tests.real_time import LOOK_S, WAIT_S, Measurement, Waiting

pytestmark = pytest.mark.untimed

BUSY, QUIET = Measurement(late=0.5), Measurement(late=0.02)


def waiting(*seen):
    looks, slept = iter(seen), []
    return Waiting(lambda: next(looks), slept.append), slept


def test_a_quiet_machine_is_not_kept_waiting():
    wait, slept = waiting(QUIET)
    assert wait.until_quiet().keeps_time
    assert slept == []


def test_a_quiet_moment_is_waited_for():
    wait, slept = waiting(BUSY, BUSY, QUIET)
    assert wait.until_quiet().keeps_time
    assert slept == [LOOK_S, LOOK_S]


def test_a_machine_that_stays_busy_is_waited_for_once_in_a_run():
    longest = round(WAIT_S / LOOK_S)
    wait, slept = waiting(*[BUSY] * (longest + 2))
    assert not wait.until_quiet().keeps_time
    assert len(slept) == longest
    assert not wait.until_quiet().keeps_time
    assert len(slept) == longest
