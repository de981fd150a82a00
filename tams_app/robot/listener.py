"""The events of control and policy loop, as the parts around them receive them."""

from __future__ import annotations

from collections.abc import Sequence

from tams_app.records import (
    Allocation,
    ArmState,
    PacketRecord,
    PhaseChange,
    PinnedView,
    StopRecord,
    Tick,
    UplinkSummary,
)
from tams_app.teleop.records import TeleopOutput

TOO_LONG_AGO = "not confirmed: the operator did so too long ago"


class Listener:
    """A part that receives each step of a session; events that it does not override are ignored.

    Nothing here may block. `on_uplink` and `on_allocation` are called in the policy thread, the
    others in the control thread, in this order within a tick. The listeners of a session receive
    each event in the order in which `Engine` names them.
    """

    def on_wake(self, now_ns: int) -> None:
        """The computer was suspended since the last tick; called before `before_tick`.

        Args:
            now_ns: the time of the tick [ns].
        """

    def before_tick(self, now_ns: int) -> None:
        """A tick begins, and has looked at neither controller, arm nor signals.

        Args:
            now_ns: the time of the tick [ns].
        """

    def on_late_confirm(self) -> None:
        """A confirmation has come that was given too long ago to count."""

    def on_pinned(self, pin: PinnedView) -> None:
        """The operator has pinned a view, or let it go; the tick has not begun to judge the video.

        Args:
            pin: the view, and the time of the tick [ns].
        """

    def on_phase(self, change: PhaseChange) -> None:
        """The arm has been sent its command, and a phase has begun.

        Args:
            change: the phase and when it began [ns].
        """

    def on_output(self, now_ns: int, output: TeleopOutput, arm: ArmState | None) -> None:
        """Teleoperation has decided.

        Args:
            now_ns: the time of the tick [ns].
            output: command, arming, reason and the rest of its decision.
            arm: the report that it looked at; None: there was none.
        """

    def on_tick(self, tick: Tick) -> None:
        """A tick is over.

        Args:
            tick: the whole tick as it is logged.
        """

    def on_stop(self, stop: StopRecord) -> None:
        """A stop that was not the operator's own release is over, and recorded.

        Args:
            stop: its reason and times [ns].
        """

    def on_uplink(self, reported: Sequence[PacketRecord], summary: UplinkSummary) -> None:
        """Receivers have reported packets, for the next allocation.

        Args:
            reported: the packets, each once.
            summary: all of the report in sums.
        """

    def on_allocation(self, allocation: Allocation) -> None:
        """The encoders have new targets.

        Args:
            allocation: the targets [kbit/s] and the capacity and budget that they follow from.
        """
