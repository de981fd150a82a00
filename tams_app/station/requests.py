"""An operator's requests to a robot elsewhere, kept until they have been sent."""

from __future__ import annotations

from operator import add

from tams_app.records import EpisodeRequest


class Requests:
    """The operator's requests by key or button; from any thread, also from a signal handler."""

    def __init__(self) -> None:
        self.confirms = self.stops = 0
        self.confirmed_ns = 0
        self.has_failed = False
        self.pinned = ""  # view that the operator has pinned; "": none
        self.episodes = (0, 0, 0, 0, 0)  # by `EpisodeRequest`

    def episode(self, request: EpisodeRequest) -> None:
        """Something is asked about episodes."""
        added = (one is request for one in EpisodeRequest)
        first, second, third, fourth, fifth = map(add, self.episodes, added)
        self.episodes = first, second, third, fourth, fifth

    def confirm(self, asked_ns: int) -> None:
        """The operator agrees: arm, or clear a fault. They did so at `asked_ns` at the earliest."""
        self.confirmed_ns = asked_ns
        self.confirms += 1

    def forget_confirmation(self) -> None:
        """One that was not sent yet is too old."""
        self.confirmed_ns = 0

    def estop(self) -> None:
        """Emergency stop."""
        self.stops += 1

    def fail(self) -> None:
        """This side has failed: from now on the hand is one that was put down."""
        self.has_failed = True
