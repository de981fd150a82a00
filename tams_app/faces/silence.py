"""Detection of a display that is not live any more, and its words; one rule for all; pure."""

from __future__ import annotations

import msgspec

from tams_app.faces.messages import FaceFacts
from tams_app.records import LINK_LOST, SessionState, ViewState
from tams_app.units import NS_PER_MS, NS_PER_S

NOT_LIVE = "not live"  # in the place of a state of the arming table
LIVE_NS = 3 * NS_PER_S // 10
NOT_RECEIVED = "Nothing has been received of the arm for {seconds} s: what is shown is old."
STILL_STOPS = "The emergency stop button on the arm's control box"


def silent_s(heard_ns: int | None, now_ns: int) -> float | None:
    """Time [s] without news of the arm; None while that is short, or no session.

    `heard_ns`: when the shown state was true, on the monotonic clock of this computer: of the
    control loop's last tick, or when the robot's side's last message came; None: of no session.
    """
    if heard_ns is None or now_ns - heard_ns <= LIVE_NS:
        return None
    return (now_ns - heard_ns) / NS_PER_S


def silence_of(state: SessionState) -> float | None:
    """`silent_s` of a state, at its own moment."""
    return silent_s(state.heard_ns, state.now_ns)


def as_known(facts: FaceFacts, now_ns: int) -> FaceFacts:
    """The facts as they may be shown at `now_ns`: where they are not live, that and their age.

    The application that is silent itself reports nothing of the link either; one that is not may
    report that it is lost.
    """
    state = facts.state
    if facts.replay is not None or facts.end is not None:
        return facts
    silence_s = silent_s(min(facts.reported_ns, state.heard_ns or facts.reported_ns), now_ns)
    if silence_s is None:
        return facts
    passed_ms = (now_ns - facts.reported_ns) / NS_PER_MS
    knows_why = state.arming == LINK_LOST and silent_s(facts.reported_ns, now_ns) is None
    old = msgspec.structs.replace(
        state,
        arming=state.arming if knows_why else NOT_LIVE,
        reason="",
        deadman=None,
        pressed=(),
        views={name: _aged(view, passed_ms) for name, view in state.views.items()},
    )
    return msgspec.structs.replace(facts, state=old, advice="", silent_s=silence_s)


def not_received(silence_s: float) -> str:
    """A sentence that no state of the arm has arrived for `silence_s`."""
    return NOT_RECEIVED.format(seconds=f"{silence_s:.1f}")


def _aged(view: ViewState, passed_ms: float) -> ViewState:
    age_ms = None if view.age_ms is None else view.age_ms + passed_ms
    return msgspec.structs.replace(view, age_ms=age_ms)
