"""Choice of the simulated operator of a live session: one who sees, or one who is given poses.

The seeing operator's eyes get a fixed part of the machine. They are too slow for the task if that
is not enough for a few glances a second.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tams_app.config import OperatorKind
from tams_app.runtime.machine_speed import MachineSpeed

GLANCE_S = 0.0117  # processor time of one on the reference: `benchmarks.glance_cost` at 628dd78b
SHARE_OF_MACHINE = 0.10  # of all cores, for the eyes
LEAST_GLANCES_HZ = 6.0
MOST_GLANCES_HZ = 15.0  # no participant looks more often


@dataclass(frozen=True, slots=True)
class OperatorChoice:
    """The operator's `kind`, seeing or scripted, and a sentence for the session's first line."""

    kind: OperatorKind
    sentence: str


def choose_operator(
    wanted: OperatorKind, this_machine: Callable[[], MachineSpeed]
) -> OperatorChoice:
    """The operator that is `wanted`; for `auto` the seeing one where the machine has the time.

    `this_machine`: measures its speed; asked for `auto` only.
    """
    if wanted == "scripted":
        return OperatorChoice("scripted", f"{_SCRIPTED}, as configured")
    if wanted == "seeing":
        return OperatorChoice("seeing", f"{_SEEING}, as configured")
    machine = this_machine()
    cost_s = GLANCE_S / machine.speed
    rate_hz = eyes_share(machine.cores) / cost_s
    time = f"this machine needs {1e3 * cost_s:.0f} ms for an image, which allows"
    if rate_hz >= LEAST_GLANCES_HZ:
        return OperatorChoice(
            "seeing", f"{_SEEING}: {time} {min(rate_hz, MOST_GLANCES_HZ):.0f} images a second"
        )
    return OperatorChoice(
        "scripted",
        f"{_SCRIPTED}: {time} {rate_hz:.1f} images a second; seeing takes {LEAST_GLANCES_HZ:.0f}",
    )


def eyes_share(cores: float) -> float:
    """The part of one core that the eyes may use."""
    return min(1.0, SHARE_OF_MACHINE * cores)


_SEEING = "simulated operator: seeing (uses only the received images)"
_SCRIPTED = "simulated operator: scripted (gets positions from the simulator)"
