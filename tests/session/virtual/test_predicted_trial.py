"""A trial whose wrist view is drawn as it would look now."""

from __future__ import annotations

import numpy as np
import pytest

from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.summary.summarise import summarise
from tests.session.virtual.runs import run, short

pytestmark = pytest.mark.untimed


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, SessionLog]:
    """The same trial without, with, and with an operator who looks at what is shown."""
    found = {}
    for name, predict, looks_at in (
        ("off", "off", "shown"),
        ("eih", "eih", "received"),
        ("seen", "eih", "shown"),
    ):
        folder = tmp_path_factory.mktemp(name)
        options = {"view.predict": predict, "rig.operator.looks_at": looks_at}
        run(short(network="s2", seconds=8.0, **options), folder)
        found[name] = read_log(folder / LOG_NAME)
    return found


def live(log: SessionLog, view: str) -> np.ndarray:
    """Of each frame captured while the arm moved."""
    moving = [tick.started_ns for tick in log.ticks if tick.speed > 0.02]
    return np.array(
        [
            one.live
            for one in log.quality
            if one.view == view and one.live is not None and moving[0] < one.capture_ns < moving[-1]
        ]
    )


def test_the_wrist_view_is_more_like_the_present_while_the_arm_moves(
    logs: dict[str, SessionLog],
) -> None:
    late, predicted = live(logs["off"], "eih"), live(logs["eih"], "eih")
    assert len(late) == len(predicted) > 20
    assert predicted.mean() > late.mean() + 0.05


def test_all_else_of_the_trial_stays_as_it_is(logs: dict[str, SessionLog]) -> None:
    assert (live(logs["off"], "gt") == live(logs["eih"], "gt")).all()
    assert [tick.twist for tick in logs["off"].ticks] == [tick.twist for tick in logs["eih"].ticks]
    pair = logs["off"], logs["eih"]
    received = [[one.received for one in log.quality] for log in pair]
    assert received[0] == received[1]
    shown = [[(one.view, one.index, one.shown_ns) for one in log.shown] for log in pair]
    assert shown[0] == shown[1]


def test_the_summary_names_the_views_that_were_drawn_so(logs: dict[str, SessionLog]) -> None:
    assert summarise(logs["eih"])["predicted_views"] == ["eih"]
    assert summarise(logs["off"])["predicted_views"] == []


def test_the_log_tells_how_near_the_predictions_came(logs: dict[str, SessionLog]) -> None:
    found = summarise(logs["eih"])["prediction"]
    assert found["error_mm"]["p95"] < 1.0
    assert found["newest_state_mm"]["p50"] > 4.0
    assert found["trusted_fraction"] > 0.95
    assert logs["off"].predictions == []


def test_the_operator_looks_at_what_is_drawn_or_at_the_frames_as_received(
    logs: dict[str, SessionLog],
) -> None:
    off, received, shown = ([one.to_block for one in log.glances] for log in logs.values())
    assert off == received
    assert off != shown
