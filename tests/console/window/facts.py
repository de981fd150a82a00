"""Facts of a session in full swing."""

from tams_app.console.window.messages import Facts, Opening, ViewFacts, Workspace

FACTS = Facts(
    t_s=12.5,
    arming="engaged",
    reason="",
    advice="",
    last_stop="",
    deadman=True,
    pressed=("A",),
    orientation_mode=False,
    gripper_closed=True,
    phase="TRANSPORT",
    primary_view="eih",
    tcp_mm=(350.0, -80.0, 180.0),
    views={
        "eih": ViewFacts(3000, 2950, 29.8, 74, 95),
        "gt": ViewFacts(1500, 1480, 30, 75, 96),
        "gs": ViewFacts(900, 870, 30, 76, 97),
    },
    link_kbps=5210,
    budget_kbps=5520,
    capacity_kbps=6000,
    queue_ms=12.3,
    loss=0.003,
    asked_fps=30,
)

OPENING = Opening(
    views=("eih", "gt", "gs"),
    width=640,
    height=480,
    workspace=Workspace((220, -250, 5), (410, 250, 350), 220, 420),
    blind=False,
    hand="openvr",
    old_ms=500.0,
)
