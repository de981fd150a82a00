"""The boxes that the arm's controller is given."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.arms import reach_boundary, session_boundary
from hw.lite6.commands import boundary_edges
from hw.lite6.kinematics import HOME_JOINTS, Lite6Model, offset_from_mm_deg
from tams_app.config import ArmConfig, LimitsConfig

pytestmark = pytest.mark.untimed

ARM, LIMITS = ArmConfig(), LimitsConfig()
edges = st.floats(-400, 400, allow_nan=False)


@given(corner=st.tuples(edges, edges, edges), size=st.floats(1, 300), margin=st.floats(5, 200))
def test_the_boundary_is_whole_millimetres_never_nearer_than_the_margin(
    corner: tuple[float, float, float], size: float, margin: float
) -> None:
    upper = tuple(edge + size for edge in corner)
    limits = LIMITS.model_copy(
        update={"box_min_mm": corner, "box_max_mm": upper, "floor_mm": corner[2]}
    )
    made = session_boundary(ARM.model_copy(update={"boundary_margin_mm": margin}), limits)
    outside_low = np.array(corner) - np.array(made.lower_mm)
    outside_high = np.array(made.upper_mm) - np.array(upper)
    for outside in (outside_low, outside_high):
        assert (outside >= margin - 1e-9).all()
        assert (outside < margin + 1.0 + 1e-9).all()


def test_the_floor_counts_where_it_is_above_the_box() -> None:
    limits = LIMITS.model_copy(update={"floor_mm": 50.0})
    assert session_boundary(ARM, limits).lower_mm[2] == 50 - ARM.boundary_margin_mm


def test_the_wire_wants_the_upper_edge_of_each_axis_first() -> None:
    made = session_boundary(ARM, LIMITS)
    margin = round(ARM.boundary_margin_mm)
    assert boundary_edges(made) == [
        420 + margin,
        150 - margin,
        330 + margin,
        -330 - margin,
        400 + margin,
        5 - margin,
    ]


def test_a_boxs_edges_fit_the_register_however_far_they_are_configured() -> None:
    limits = LIMITS.model_copy(update={"box_max_mm": (1e9, 1e9, 1e9)})
    assert max(boundary_edges(session_boundary(ARM, limits))) == 9999


def test_the_boundary_for_the_way_home_holds_every_pose_above_the_floor() -> None:
    made = reach_boundary(ARM, LIMITS)
    model = Lite6Model(offset_from_mm_deg(ARM.tcp_offset_mm_deg))
    assert made.contains(model.tcp_matrix(HOME_JOINTS)[:3, 3])
    random = np.random.default_rng(0)
    for _ in range(500):
        position = model.tcp_matrix(np.radians(random.uniform(-120, 250, 6)))[:3, 3]
        assert made.contains(position) or position[2] < made.lower_mm[2] / 1000.0
    assert not made.contains(np.array([0.3, 0.0, -0.1]))
