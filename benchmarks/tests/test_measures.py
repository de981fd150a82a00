from __future__ import annotations

import pytest

from benchmarks.measures import settling_time_s
from tams_app.summary.tables import LogTables
from tams_app.summary.views import windows
from tams_app.units import NS_PER_S
from tests.synthetic_session import START_NS, Synthetic, overshoot

pytestmark = pytest.mark.untimed


def test_settled_is_the_first_window_from_which_all_stay_within_15_percent() -> None:
    log = Synthetic(6.0, switch_s=3.0).log()
    overshoot(log, 3.0, 3.2, factor=2)  # frames 90 to 95
    found = windows(LogTables(log), "eih")
    step_ns = START_NS + 3 * NS_PER_S
    # a window with one doubled frame is 12.5 % off: the one from frame 95 on is the first settled
    assert settling_time_s(found, step_ns, log.ended_ns) == pytest.approx(5 / 30, abs=1e-6)
    overshoot(log, 5.8, 6.0, factor=2)
    worse = windows(LogTables(log), "eih")
    assert settling_time_s(worse, step_ns, log.ended_ns + NS_PER_S) is None
