"""Facts of a session in full swing."""

from typing import Any

from msgspec.structs import replace

from tams_app.faces.messages import FaceFacts, Opening, ShownWorkspace
from tams_app.records import SessionState, ViewState

STATE = SessionState(
    t_s=12.5,
    arming="engaged",
    deadman=True,
    pressed=("A",),
    gripper_closed=True,
    hand="openvr",
    phase="TRANSPORT",
    primary_view="eih",
    tcp_mm=(350.0, -80.0, 180.0),
    views={
        "eih": ViewState(3000, 2950, 29.8, 74, 95),
        "gt": ViewState(1500, 1480, 30, 75, 96),
        "gs": ViewState(900, 870, 30, 76, 97),
    },
    link_kbps=5210,
    budget_kbps=5520,
    capacity_kbps=6100,
    estimate_kbps=6000,
    queue_ms=12.3,
    loss=0.003,
    asked_fps=30,
)
FACTS = FaceFacts(STATE)

OPENING = Opening(
    views=("eih", "gt", "gs"),
    width=640,
    height=480,
    workspace=ShownWorkspace((220, -250, 5), (410, 250, 350), 220, 420),
    blind=False,
    hand="openvr",
    old_ms=500.0,
)


def changed(facts: FaceFacts, **changes: Any) -> FaceFacts:
    """The facts with other values, also of their state."""
    of_facts = {name: changes.pop(name) for name in FaceFacts.__struct_fields__ if name in changes}
    return replace(facts, **{"state": replace(facts.state, **changes), **of_facts})
