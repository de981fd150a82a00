"""What happens in a session's loops, as the parts around them receive it: record by record."""

from __future__ import annotations

from tams_app.records import Record


class Listener:
    """A part that receives what the control loop and the policy loop record.

    Nothing here may block. Records of the control loop (`PinnedView`, `PhaseChange`, a `Note` on a
    confirmation that came too late, the `Tick`, then what follows from it: `Note`, `StopRecord`)
    come in the control thread, once the arm has its command; those of the policy loop
    (`UplinkSummary`, `PolicyInputs`, and last the `Allocation`, which the encoders have by then) in
    the policy thread. The listeners of a session receive each record in the order in which `Engine`
    names them.
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

    def receive(self, record: Record) -> None:
        """Something has happened.

        Args:
            record: as the log keeps it.
        """
