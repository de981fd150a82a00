"""The six phases by geometry, on scenes built by hand."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.phases.fit import CODE, NOT_COUNTED, PHASES
from calibration.phases.labels import (
    Geometry,
    geometric_labels,
    marked_labels,
    true_labels,
)
from tams_app.console.replay.marks import Mark
from tams_app.errors import LogError
from tams_app.records import Phase
from tams_app.task.judge import TaskGeometry
from tests.calibration.phase_trials import (
    BLOCK,
    CONTAINER,
    PERIOD_S,
    PICK,
    PLACE,
    WHOLE,
    Leg,
    over,
    session,
    walk,
)

pytestmark = pytest.mark.untimed

SIZES = TaskGeometry(container_inner=0.090, container_height=0.030, block_rest_height=0.010)
PATH = walk(WHOLE)
SCENE = PATH.geometry()
LABELS = geometric_labels(SCENE)
ALL_SIX = ["REACH", "ALIGN", "GRASP", "TRANSPORT", "PRE_RELEASE", "RELEASE", "REACH"]


def order(labels: np.ndarray) -> list[str]:
    """The phases in their order, `-` where nothing counts."""
    return [PHASES[code].value if code != NOT_COUNTED else "-" for code, _ in groupby(labels)]


ASIDE = (float(BLOCK[0]), float(BLOCK[1]) + 0.10, 0.15)
TABLE = np.array([0.33, 0.05, 0.0])
LAID_DOWN = (
    Leg(1.0, over(TABLE, 0.13)),
    Leg(0.8, over(TABLE, 0.012)),
    Leg(0.2, over(TABLE, 0.012), then_closed=False),
    Leg(0.4, over(TABLE, 0.012)),
)
OPENED = Leg(0.1, over(BLOCK, 0.13), then_closed=False)


@pytest.mark.parametrize(
    ("legs", "carries", "phases"),
    [
        (WHOLE, True, ALL_SIX),  # withdrawing above the placed block is not aligning
        ((*PICK[:2], Leg(0.5, ASIDE), *WHOLE), True, ALL_SIX),  # nor is passing over the block
        (PICK[:3], True, ["REACH", "ALIGN"]),  # it ends over the block
        # closing on nothing is grasping until the tool leaves, and opening with nothing no release;
        # standing above the block with open fingers again is aligning, as the trial ends so
        (PICK, False, ["REACH", "ALIGN", "GRASP", "-"]),
        ((*PICK, OPENED, *PICK[2:3]), False, ["REACH", "ALIGN", "GRASP", "-", "ALIGN"]),
        # laid down beside the container there is no pre-release
        ((*PICK, *LAID_DOWN), True, ["REACH", "ALIGN", "GRASP", "TRANSPORT", "RELEASE"]),
    ],
)
def test_a_trial_goes_through_the_phases_of_what_it_does(legs, carries, phases) -> None:
    assert order(geometric_labels(walk(legs, carries=carries).geometry())) == phases


def first(phase: Phase, labels: np.ndarray = LABELS) -> int:
    """The tick in which it begins."""
    return int(np.argmax(labels == CODE[phase]))


def test_aligning_begins_where_the_tool_comes_over_the_block_and_lasts_until_it_closes() -> None:
    begin = first(Phase.ALIGN)
    beside = np.linalg.norm((PATH.tool - PATH.block)[:, :2], axis=1)
    assert beside[begin] <= 0.020 < beside[begin - 1]
    assert np.argmax(PATH.closed) == first(Phase.GRASP)
    standing = slice(round(1.05 / PERIOD_S), round(1.35 / PERIOD_S))
    assert (LABELS[standing] == CODE[Phase.ALIGN]).all()


def test_grasping_ends_when_the_block_leaves_the_table() -> None:
    begin, height = first(Phase.TRANSPORT), PATH.block[:, 2] - 0.010
    assert height[begin - 1] < 0.003 <= height[begin]


def test_pre_release_begins_where_the_block_comes_over_the_container() -> None:
    begin = first(Phase.PRE_RELEASE)
    beside = np.abs((PATH.block - CONTAINER)[:, :2]).max(axis=1)
    assert beside[begin] <= 0.045 < beside[begin - 1]


def test_release_ends_when_the_fingertips_are_clear_of_the_block() -> None:
    opened = np.flatnonzero(CODE[Phase.RELEASE] == LABELS)
    moved = np.linalg.norm(PATH.tool - PATH.tool[opened[0]], axis=1)
    assert not PATH.closed[opened[0]]
    assert PATH.closed[opened[0] - 1]
    assert moved[opened[-1]] <= 0.010 < moved[opened[-1] + 1]


def test_a_block_that_falls_out_of_the_fingers_ends_the_transport() -> None:
    path = walk((*PICK, *PLACE[:1]))
    fallen = round(4.5 / PERIOD_S)
    path.block[fallen:] = [*path.block[fallen, :2], 0.010]
    labels = geometric_labels(path.geometry())
    assert order(labels) == ["REACH", "ALIGN", "GRASP", "TRANSPORT", "-"]
    assert np.argmax(labels[fallen:] == NOT_COUNTED) == 0


@given(st.lists(st.integers(1, 4), min_size=20, max_size=20))
def test_playing_a_trial_slower_or_faster_changes_no_phase(times: list[int]) -> None:
    """The definition knows no speed: were every tick repeated, so would its label be."""
    repeats = np.resize(times, len(SCENE.closed))
    names = ("tool", "block", "over_container", "closed")
    arrays = {name: np.repeat(getattr(SCENE, name), repeats, axis=0) for name in names}
    slower = Geometry(**arrays, block_rest_height=SCENE.block_rest_height)
    assert (geometric_labels(slower) == np.repeat(LABELS, repeats)).all()


def test_what_precedes_the_first_engagement_is_not_counted() -> None:
    ticks, scene = session(PATH, lead_s=0.5)
    labels = true_labels("a trial", ticks, scene, SIZES)
    lead = round(0.5 / PERIOD_S)
    assert (labels[:lead] == NOT_COUNTED).all()
    assert order(labels[lead:]) == ALL_SIX


def test_a_scene_known_thirty_times_a_second_labels_ticks_as_one_known_at_each() -> None:
    labels = true_labels("a trial", *session(PATH, lead_s=0.0), SIZES)
    assert np.count_nonzero(labels != LABELS) <= 4 * len(ALL_SIX)


def test_a_tick_without_an_arm_state_keeps_what_was_known() -> None:
    ticks, scene = session(PATH, lead_s=0.0)
    whole = true_labels("a trial", ticks, scene, SIZES)
    ticks[300] = replace(ticks[300], arm=None)
    assert (true_labels("a trial", ticks, scene, SIZES) == whole).all()


def test_a_log_that_does_not_know_where_things_were_or_when_the_arm_followed_is_refused() -> None:
    ticks, scene = session(PATH)
    with pytest.raises(LogError, match=r"a trial: has no record of where the block was"):
        true_labels("a trial", ticks, [], SIZES)
    idle = [replace(tick, deadman=False, arming="ready") for tick in ticks]
    with pytest.raises(LogError, match="has no record of an engagement of the arm"):
        true_labels("a trial", idle, scene, SIZES)


def test_a_phase_holds_from_its_mark_to_the_next_and_nothing_before_the_first() -> None:
    t_s = np.array([0.0, 0.99, 1.0, 2.49, 2.5, 3.9, 4.0, 7.0])
    nothing, reach, align = NOT_COUNTED, CODE[Phase.REACH], CODE[Phase.ALIGN]
    marks = [Mark(1.0, Phase.REACH), Mark(2.5, Phase.ALIGN), Mark(4.0, None)]
    expected = [nothing, nothing, reach, reach, align, align, nothing, nothing]
    assert marked_labels(marks, t_s).tolist() == expected
    assert marked_labels([], t_s).tolist() == [nothing] * 8
