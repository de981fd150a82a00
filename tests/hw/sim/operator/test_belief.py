import math
from dataclasses import replace

import numpy as np
import pytest

from hw.sim.operator.belief import Belief
from hw.sim.operator.belief_state import (
    BLOCK,
    BLOCK_Z,
    CONTAINER,
    TO_BLOCK,
    TOOL,
    TURN,
)
from hw.sim.operator.vision.views import (
    Cue,
    HeadingSighting,
    Sighting,
    Thing,
)

pytestmark = pytest.mark.untimed

BLOCK_PLACE = np.array([0.33, -0.12, 0.01])
TCP = np.array([0.34, -0.11, 0.10])


def _settled() -> Belief:
    """One who has looked at tool, block and container for a while."""
    belief = Belief()
    belief.state[TOOL] = TCP
    for _ in range(10):
        _look(belief)
    return belief


def _sighting(belief, view, thing, place, sigma_px=0.3):
    pixel = belief.camera(view).project(np.asarray(place)[None])
    return Sighting(view, thing, pixel, np.zeros((1, 3)), sigma_px)


def _look(belief, tcp=TCP, block=BLOCK_PLACE, views=("gt", "gs"), moved=0.0, sigma_px=0.3):
    before = belief.state.copy()
    belief.predict(np.zeros(3) + moved, np.zeros(3), 0.08)
    belief.hold_to_table()
    sightings = [_sighting(belief, view, Thing.TOOL, tcp, sigma_px) for view in views]
    if block is not None:
        sightings += [_sighting(belief, view, Thing.BLOCK, block, sigma_px) for view in views]
    belief.take(sightings)
    belief.learn_carried_part(before)


def test_two_views_together_find_tool_and_block():
    belief = _settled()
    assert belief.tcp == pytest.approx(TCP, abs=0.0005)
    assert belief.block == pytest.approx(BLOCK_PLACE, abs=0.0005)
    assert belief.gap_sigma(TO_BLOCK) < 0.001


def test_a_sharper_view_counts_for_more():
    belief = _settled()
    belief.predict(np.zeros(3), np.zeros(3), 0.08)
    sharp = _sighting(belief, "gt", Thing.BLOCK, BLOCK_PLACE, 0.3)
    belief.take([sharp, _sighting(belief, "gs", Thing.BLOCK, BLOCK_PLACE, 3.0)])
    shares = belief.shares(TO_BLOCK)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["gt"] > 10.0 * shares["gs"]


def test_one_view_against_the_other_is_not_believed_but_both_are():
    elsewhere = BLOCK_PLACE + np.array((0.0, 0.06, 0.0))
    belief = _settled()
    for _ in range(5):
        belief.predict(np.zeros(3), np.zeros(3), 0.08)
        right = _sighting(belief, "gs", Thing.BLOCK, BLOCK_PLACE)
        belief.take([_sighting(belief, "gt", Thing.BLOCK, elsewhere), right])
    assert belief.block == pytest.approx(BLOCK_PLACE, abs=0.002)
    for _ in range(8):
        _look(belief, block=elsewhere)
    assert belief.block == pytest.approx(elsewhere, abs=0.002)


@pytest.mark.parametrize("view", ["gt", "gs"])
def test_a_block_seen_far_away_by_one_view_is_believed_to_lie_on_the_table_there(view):
    far_away = np.array((0.34, 0.30, 0.01))
    belief = _settled()
    for _ in range(4):
        belief.predict(np.zeros(3), np.zeros(3), 0.08)
        belief.hold_to_table()
        belief.take([_sighting(belief, view, Thing.BLOCK, far_away)])
    assert belief.block == pytest.approx(far_away, abs=0.003)


def _stare(belief, glances, moved=0.0, **errors):
    """Look at the block in one view again and again, the image being the same."""
    for _ in range(glances):
        belief.predict(np.zeros(3) + moved, np.zeros(3), 0.0)
        seen = _sighting(belief, "gt", Thing.BLOCK, BLOCK_PLACE, 0.1)
        belief.take([replace(seen, **errors)])
    return belief.sigma_of(Thing.BLOCK)


def test_looking_again_at_the_same_image_does_not_reduce_lasting_errors():
    once, often = (_stare(_settled_far(), glances, lasting_px=2.0) for glances in (3, 300))
    pixel_m = 1.0 / np.linalg.norm(_settled().camera("gt").jacobian(BLOCK_PLACE), axis=1).max()
    assert often > 0.95 * once
    assert often > 1.5 * pixel_m
    assert _stare(_settled_far(), 300) < 0.1 * often


def test_an_error_that_lasts_is_another_once_the_image_has_changed():
    belief = _settled()
    place = belief._lasting.of("gt", Thing.TOOL, Cue.COLOUR)
    belief.covariance[TOOL, TOOL] = np.eye(3) * 0.01**2
    belief.take([replace(_sighting(belief, "gt", Thing.TOOL, TCP), lasting_px=3.0)])

    def shared():
        return np.abs(belief.estimate.covariance[place, TOOL]).max()

    at_first = shared()
    belief.predict(np.zeros(3), np.zeros(3), 10.0)
    assert shared() == at_first > 0.0
    belief.predict(np.array([0.0, 0.2, 0.0]), np.zeros(3), 0.1)
    assert shared() < 0.05 * at_first
    assert belief.estimate.covariance[place, place] == pytest.approx(np.eye(2))


def test_views_that_move_while_they_are_drawn_count_for_less():
    def sigma_after(moved):
        belief = _settled()
        belief.covariance[TOOL, TOOL] = np.eye(3) * 0.01**2
        belief.predict(moved, np.zeros(3), 0.08)
        belief.covariance[TOOL, TOOL] = np.eye(3) * 0.01**2
        belief.take([_sighting(belief, view, Thing.TOOL, belief.tcp) for view in ("gt", "gs")])
        return belief.sigma_of(Thing.TOOL)

    assert sigma_after(np.array([0.008, 0.0, 0.0])) > 2.0 * sigma_after(np.zeros(3))


def test_a_block_high_in_opening_fingers_may_have_fallen():
    belief = _settled()
    belief.state[BLOCK] = belief.tcp
    belief.note_fingers_moved()
    assert math.sqrt(belief.covariance[BLOCK_Z, BLOCK_Z]) > 0.4 * (TCP[2] - 0.01)


def _settled_far():
    """One who has lost sight of where the block is."""
    belief = _settled()
    belief.covariance[BLOCK, BLOCK] += np.diag((0.05, 0.05, 0.0)) ** 2
    return belief


@pytest.mark.parametrize("carried", [True, False])
def test_whether_the_block_carried_part_is_learnt_by_looking(carried):
    held = TCP - (0.0, 0.0, 0.001)
    belief = Belief()
    belief.state[TOOL] = TCP
    belief.state[BLOCK] = held
    belief.seen[Thing.BLOCK] = True
    belief.note_fingers_moved()
    for _ in range(4):
        _look(belief, block=held)
    step = np.array([0.0, 0.0, 0.005])
    for glance in range(1, 5):
        _look(belief, TCP + glance * step, held + glance * step * carried, moved=step)
    assert (belief.carried_part > 0.7) is carried
    assert (belief.carried_part < 0.3) is not carried


@pytest.mark.parametrize("carried", [0.0, 1.0])
def test_a_wrist_view_ahead_of_the_others_tells_the_same_of_where_things_are(carried):
    """Tool, and block if it is carried, are further on in it by what was asked meanwhile."""
    belief = _settled()
    if carried:
        belief.state[BLOCK] = belief.tcp + np.array((0.0, 0.0, -0.01))
        belief.carried_part = carried
    moved, turned = np.array([0.03, -0.02, 0.01]), np.array([0.0, 0.0, 0.3])
    before, known = belief.state.copy(), belief.gap_sigma(TO_BLOCK)
    with belief.ahead_by(moved, turned):
        assert belief.tcp == pytest.approx(before[TOOL] + moved)
        place = before[BLOCK] + carried * moved
        belief.take([_sighting(belief, "eih", Thing.BLOCK, place)])
    assert belief.state == pytest.approx(before, abs=1e-9)
    assert belief.gap_sigma(TO_BLOCK) < known


def test_what_the_wrist_view_passes_by_is_what_the_image_does():
    belief = _settled()
    sighting = _sighting(belief, "eih", Thing.CONTAINER, (*belief.state[CONTAINER], 0.0))
    slope = belief.passes(sighting)
    for axis in range(6):
        step = 1e-5 * np.eye(6)[axis]
        with belief.ahead_by(step[:3], step[3:]):
            now = _sighting(belief, "eih", Thing.CONTAINER, (*belief.state[CONTAINER], 0.0))
        moved = (now.pixels - sighting.pixels)[0] / 1e-5
        assert slope[:, axis] == pytest.approx(moved, rel=2e-3, abs=0.5)


def test_a_tilted_gripper_is_found_out_by_what_the_wrist_sees():
    true = _settled()
    true.state[TURN][:2] = (0.03, -0.02)
    belief = _settled()
    for _ in range(40):
        belief.predict(np.zeros(3), np.zeros(3), 0.08)
        seen = _sighting(true, "eih", Thing.BLOCK, BLOCK_PLACE)
        fixed = [
            _sighting(true, view, thing, place)
            for view in ("gt", "gs")
            for thing, place in ((Thing.TOOL, true.tcp), (Thing.BLOCK, BLOCK_PLACE))
        ]
        belief.take([seen, *fixed])
    assert belief.state[TURN][:2] == pytest.approx((0.03, -0.02), abs=0.01)


def test_a_block_seen_lying_again_and_again_is_believed_to_lie():
    belief = _settled()
    for _ in range(2):
        belief.take_heading(HeadingSighting("eih", 1.2, 0.02, lying=True))
    assert not belief.lies
    belief.take_heading(HeadingSighting("eih", 1.2, 0.02, lying=True))
    assert belief.lies
    assert belief.block_yaw - belief.tool_yaw == pytest.approx(1.2)
    belief.take_heading(HeadingSighting("eih", 1.2 - math.pi, 0.02, lying=True))
    assert belief.block_yaw - belief.tool_yaw == pytest.approx(1.2, abs=0.01)
    long_side, vertical = belief.block_axes[:, 2], belief.block_axes[2, :]
    assert long_side == pytest.approx((math.cos(1.2), math.sin(1.2), 0.0), abs=0.05)
    assert abs(vertical[0]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("view", "thing"),
    [
        ("gt", Thing.TOOL),
        ("gt", Thing.BLOCK),
        ("gt", Thing.CONTAINER),
        ("eih", Thing.BLOCK),
        ("eih", Thing.CONTAINER),
    ],
)
def test_jacobians_are_the_slopes_of_what_is_expected(view, thing):
    belief = _settled()
    points = np.array([(0.004, -0.003, 0.002)])
    seen = Sighting(view, thing, np.zeros((1, 2)), points, 1.0)
    rows, gaps = belief._compare(seen)
    state, step = belief.state.copy(), 1e-6
    for place in range(len(state)):
        belief.state[:] = state + step * np.eye(len(state))[place]
        slope = (gaps - belief._compare(seen)[1]) / step
        assert rows[:, place] == pytest.approx(slope, rel=0.02, abs=1.0), place
