"""When what is shown is not live any more, and what is said then; one rule for all displays."""

from __future__ import annotations

import msgspec

from tams_app.console.window.messages import Facts, ViewFacts
from tams_app.session.status import StatusSnapshot
from tams_app.units import NS_PER_MS, NS_PER_S

NOT_LIVE = "not live"  # in the place of a state of the arming table
LIVE_NS = 3 * NS_PER_S // 10
STILL_STOPS = "The emergency stop button on the arm's control box"


def silent_s(heard_ns: int | None, now_ns: int) -> float | None:
    """How long [s] nothing has been received of the arm; None while that is short, or no session.

    `heard_ns`: when the shown state was true, on the monotonic clock of this computer: of the
    control loop's last tick, or when the robot's side's last message came; None: of no session.
    """
    if heard_ns is None or now_ns - heard_ns <= LIVE_NS:
        return None
    return (now_ns - heard_ns) / NS_PER_S


def silence_of(snapshot: StatusSnapshot) -> float | None:
    """`silent_s` of a snapshot, at its own moment."""
    return silent_s(snapshot.heard_ns, snapshot.now_ns)


def as_known(facts: Facts, now_ns: int) -> Facts:
    """The facts as they may be shown at `now_ns`: where they are not live, that and their age.

    The application that is silent itself tells nothing of the link either; one that is not may
    tell that it is lost.
    """
    if facts.replay is not None:
        return facts
    silence_s = silent_s(min(facts.told_ns, facts.heard_ns or facts.told_ns), now_ns)
    if silence_s is None:
        return facts
    passed_ms = (now_ns - facts.told_ns) / NS_PER_MS
    knows_why = facts.arming == "link lost" and silent_s(facts.told_ns, now_ns) is None
    return msgspec.structs.replace(
        facts,
        arming=facts.arming if knows_why else NOT_LIVE,
        reason="",
        advice="",
        deadman=None,
        pressed=(),
        views={name: _aged(view, passed_ms) for name, view in facts.views.items()},
        silent_s=silence_s,
    )


def not_received(silence_s: float) -> str:
    """That nothing is, and since when."""
    return f"Nothing has been received of the arm for {silence_s:.1f} s: what is shown is old."


def _aged(view: ViewFacts, passed_ms: float) -> ViewFacts:
    age_ms = None if view.age_ms is None else view.age_ms + passed_ms
    return msgspec.structs.replace(view, age_ms=age_ms)
