"""What the parts around control and policy loop may hear from them."""

from __future__ import annotations

from collections.abc import Sequence

from tams_app.records import (
    Allocation,
    ArmState,
    PacketRecord,
    PhaseChange,
    StopRecord,
    Tick,
    UplinkSummary,
)
from tams_app.teleop.records import TeleopOutput


class Listener:
    """Hears each step of a session; what a part does not override, it ignores.

    Nothing here may block. `on_uplink` and `on_allocation` are called in the policy thread, the
    others in the control thread, in this order within a tick. The listeners of a session hear each
    event in the order in which `Engine` names them.
    """

    def on_wake(self, now_ns: int) -> None:
        """The computer was suspended since the last tick; told before `before_tick`."""

    def before_tick(self, now_ns: int) -> None:
        """A tick begins, and has looked at neither controller, arm nor signals."""

    def on_phase(self, change: PhaseChange) -> None:
        """The arm has been sent its command, and a phase has begun."""

    def on_output(self, now_ns: int, output: TeleopOutput, arm: ArmState | None) -> None:
        """What teleoperation decided; `arm` is the report that it looked at."""

    def on_tick(self, tick: Tick) -> None:
        """The whole tick as it is logged."""

    def on_stop(self, stop: StopRecord) -> None:
        """A stop that was not the operator's own release is over, and recorded."""

    def on_uplink(self, told: Sequence[PacketRecord], summary: UplinkSummary) -> None:
        """Receivers have told of packets, for the next allocation; all of it in sums."""

    def on_allocation(self, allocation: Allocation) -> None:
        """The encoders have new targets."""
