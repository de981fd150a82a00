"""Which simulated operator works in a live session: one who sees, or one who is told.

The seeing operator's eyes get a fixed part of the machine. They are too slow for the task if that
is not enough for a few glances a second.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tams_app.config import OperatorKind

SHARE_OF_MACHINE = 0.10  # of all cores, for the eyes
LEAST_GLANCES_HZ = 6.0
MOST_GLANCES_HZ = 15.0  # no participant looks more often


@dataclass(frozen=True, slots=True)
class OperatorChoice:
    """The operator's `kind`, seeing or scripted, and a sentence for the session's first line."""

    kind: OperatorKind
    sentence: str


def choose_operator(
    wanted: OperatorKind, glance_cpu_s: Callable[[], float], cores: int
) -> OperatorChoice:
    """The operator that is `wanted`; for `auto` the seeing one where the machine has the time.

    `glance_cpu_s`: measures the processor time of one glance [s]; asked for `auto` only.
    """
    if wanted == "scripted":
        return OperatorChoice("scripted", f"{_SCRIPTED}, as configured")
    if wanted == "seeing":
        return OperatorChoice("seeing", f"{_SEEING}, as configured")
    cost_s = glance_cpu_s()
    rate_hz = eyes_share(cores) / cost_s
    machine = f"a glance takes {1e3 * cost_s:.0f} ms, for which {cores} cores have time"
    if rate_hz >= LEAST_GLANCES_HZ:
        return OperatorChoice(
            "seeing", f"{_SEEING}: {machine} {min(rate_hz, MOST_GLANCES_HZ):.0f} times a second"
        )
    return OperatorChoice(
        "scripted",
        f"{_SCRIPTED}: {machine} {rate_hz:.1f} times a second, and {LEAST_GLANCES_HZ:.0f} are "
        "needed to see",
    )


def eyes_share(cores: int) -> float:
    """The part of one core that the eyes may use."""
    return min(1.0, SHARE_OF_MACHINE * cores)


_SEEING = "the seeing operator works, from the images on the screen alone"
_SCRIPTED = "the scripted operator works, who is told where things are"
